"""Public API for notebooks: measure, simulate, explain, plan; loaded lazily.

>>> import impact_vision as iv
>>> m = iv.measure("a.mp4", setup="lab.toml", wall_grid="50mm", ball="jokku")  # doctest: +SKIP
>>> m.ball_speed  # doctest: +SKIP
ball_speed: 5.2012 ± 0.0093 m/s

Importing is fast: the modules behind a name are loaded at its first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from measuring.setup.file import Setup as Setup
    from physics import effects as effects
    from pipelines.api.explained import Verdict as Verdict
    from pipelines.api.explained import explain as explain
    from pipelines.api.measured import CalibratedClip as CalibratedClip
    from pipelines.api.measured import Clip as Clip
    from pipelines.api.measured import Measurement as Measurement
    from pipelines.api.measured import calibrate as calibrate
    from pipelines.api.measured import measure as measure
    from pipelines.api.measured import render as render
    from pipelines.api.modelled import ModelResult as ModelResult
    from pipelines.api.modelled import cor as cor
    from pipelines.api.modelled import plan as plan
    from pipelines.api.modelled import simulate as simulate
    from pipelines.api.quantities import QuantityView as QuantityView
    from pipelines.campaign.conduct import Campaign as Campaign
    from pipelines.campaign.conduct import campaign as campaign
    from pipelines.law import law as law

__all__ = [
    "CalibratedClip",
    "Campaign",
    "Clip",
    "Measurement",
    "ModelResult",
    "QuantityView",
    "Setup",
    "Verdict",
    "calibrate",
    "campaign",
    "cor",
    "effects",
    "explain",
    "law",
    "measure",
    "plan",
    "render",
    "simulate",
]

_HOMES = {
    "CalibratedClip": "pipelines.api.measured",
    "Campaign": "pipelines.campaign.conduct",
    "Clip": "pipelines.api.measured",
    "Measurement": "pipelines.api.measured",
    "ModelResult": "pipelines.api.modelled",
    "QuantityView": "pipelines.api.quantities",
    "Setup": "measuring.setup.file",
    "Verdict": "pipelines.api.explained",
    "calibrate": "pipelines.api.measured",
    "campaign": "pipelines.campaign.conduct",
    "cor": "pipelines.api.modelled",
    "explain": "pipelines.api.explained",
    "law": "pipelines.law",
    "measure": "pipelines.api.measured",
    "plan": "pipelines.api.modelled",
    "render": "pipelines.api.measured",
    "simulate": "pipelines.api.modelled",
}
_MODULES = {"effects": "physics.effects"}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        found: Any = import_module(_MODULES[name])
    elif name in _HOMES:
        found = getattr(import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
