"""What an installation costs: size, packages, import time, CPU of the first measurement.

``python -m bench.install`` installs the package into a fresh virtual environment in a temporary
folder, as the first command of the README does, and prints a table. ``--environment DIR`` measures
an environment that exists; its first measurement is the first only if nothing was measured there.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from importlib.metadata import distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
CLIP = ROOT / "sample_videos" / "clips" / "basketball_60.mp4"
IMPORTS = "import pipelines.cli, pipelines.measure.commands, measuring.chain"
"""What `vision measure` imports before it opens a clip."""
_IMPORT_RUNS = 7
"""Runs of the import, of which the fastest counts: other programs only slow it (chosen)."""
_TOOLS = frozenset({"impact-vision", "pip", "setuptools"})
"""Distributions that are no dependency."""


def _install(environment: Path) -> None:
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    subprocess.run([_python(environment), "-m", "pip", "install", "-q", str(ROOT)], check=True)


def _python(environment: Path) -> str:
    return str(environment / "bin" / "python")


def _size_mb(environment: Path) -> float:
    """Bytes of all files, in MB of 10⁶ bytes."""
    files = (path for path in environment.rglob("*") if path.is_file() and not path.is_symlink())
    return sum(path.stat().st_size for path in files) / 1e6


def _packages(environment: Path) -> list[str]:
    (site,) = environment.glob("lib/python*/site-packages")
    names = {one.metadata["Name"].lower() for one in distributions(path=[str(site)])}
    return sorted(names - _TOOLS)


def _cpu_s(command: list[str], folder: Path) -> float:
    """CPU time of a command and its threads, s, run with one thread per numerical library."""
    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "IMPACT_VISION_CACHE": "off",
    }
    for name in ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX"):
        environment.pop(name, None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, cwd=folder, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def report(environment: Path, folder: Path) -> dict[str, str]:
    """The lines of the table."""
    python, vision = _python(environment), str(environment / "bin" / "vision")
    rows = {
        "size": f"{_size_mb(environment):.0f} MB",
        "packages": f"{len(_packages(environment))}",
    }
    # the first import reads the disk
    imports = [_cpu_s([python, "-c", IMPORTS], folder) for _ in range(_IMPORT_RUNS)]
    bare = [_cpu_s([python, "-c", "pass"], folder) for _ in range(_IMPORT_RUNS)]
    rows["import of what measure needs"] = f"{min(imports) - min(bare):.2f} s"
    setup = str(CLIP.with_suffix(".toml"))
    command = [vision, "measure", str(CLIP), "--setup", setup, "--quiet"]
    first, second = (_cpu_s(command, folder) for _ in range(2))
    rows["first measurement, CPU"] = f"{first:.1f} s"
    rows["second measurement, CPU"] = f"{second:.1f} s"
    rows["first beyond second, CPU"] = f"{first - second:.1f} s"
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.install", description=__doc__)
    parser.add_argument("--environment", type=Path, help="Measure this virtual environment.")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        environment = asked.environment
        if environment is None:
            environment = folder / "environment"
            _install(environment)
        for name, value in report(environment.absolute(), folder).items():
            print(f"{name:32}{value:>10}", flush=True)


if __name__ == "__main__":
    main()
