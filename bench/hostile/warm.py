"""Every command loaded once, so that each case is a fork of a few milliseconds."""

from importlib import import_module

from pipelines.cli import _COMMANDS

__all__ = ["load_commands"]


def load_commands() -> None:
    """Import what commands import when they are called; runs nothing."""
    for command in _COMMANDS.values():
        import_module(command.module)
    for name in (
        "av",
        "cv2",
        "matplotlib.figure",
        "numba",
        "openpyxl",
        "pint",
        "scipy.optimize",
        "pipelines.explain.campaign",
        "pipelines.api.explained",
        "pipelines.campaign.conduct",
        "pipelines.measure.chain",
    ):
        import_module(name)
    from metrology import parse_quantity

    # the registry of units takes half a second to build
    parse_quantity("1 furlong", "m")
