"""Draw the figures of docs/ from a sample clip and print the quantities they show.

Run: python -m bench.docs_pictures [FOLDER]

Writes demo_plots, gap, speeds, path, residuals and overlay; prints every measured quantity with its
true value.
"""

import argparse
import io
import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from measuring.chain import MeasureOptions, measure_clip
from measuring.setup.file import load_setup
from metrology.quantity import format_quantity
from pipelines.measure.files import overlay_marks, report_input
from pipelines.report.plots import PANELS, plot_panel, styled_figure, write_plot
from vision.clip.clip import ClipReader
from vision.overlay import overlay_still

ROOT = Path(__file__).parents[1]
CLIP = ROOT / "sample_videos" / "clips" / "basketball_60.mp4"
FLYING, WIDTH = 150, 1000


def saved(figure: Figure, path: Path) -> None:
    """Write a figure with a reduced palette."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=118)
    picture = Image.open(buffer).convert("RGB").quantize(128, Image.Quantize.FASTOCTREE)
    picture.save(path, optimize=True)


def main() -> None:
    """Measure the sample clip and write the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "docs" / "pictures")
    folder = parser.parse_args().folder
    measured = measure_clip(CLIP, MeasureOptions(setup=load_setup(CLIP.with_suffix(".toml"))))
    shown = report_input(measured, None)
    write_plot(folder / "demo_plots.png", shown)
    plots = Image.open(folder / "demo_plots.png").convert("RGB")
    plots = plots.resize((WIDTH, round(WIDTH * plots.height / plots.width)))
    plots.quantize(128, Image.Quantize.FASTOCTREE).save(folder / "demo_plots.png", optimize=True)
    for name in PANELS:
        with styled_figure(6.2, 3.5) as figure:
            plot_panel(shown, figure.subplots(), name)
            saved(figure, folder / f"{name}.png")
    marks = overlay_marks(measured)
    still = overlay_still(ClipReader.open(CLIP), measured.tracks, marks, frame=FLYING)
    picture = Image.fromarray(np.ascontiguousarray(still[:, :, ::-1]))
    few = picture.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.FLOYDSTEINBERG)
    few.save(folder / "overlay.png", optimize=True)
    truth = json.loads(CLIP.with_name(f"{CLIP.stem}.truth.json").read_text())["quantities"]
    for item in (*measured.quantities, *measured.other_speeds, measured.gravity):
        true = truth.get(item.name, {}).get("value")
        print(f"{item.name}: {format_quantity(item)} (truth: {true})")


if __name__ == "__main__":
    main()
