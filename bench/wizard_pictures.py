"""Pictures of docs/calibration.md: the wizard on a sample clip, step by step.

Run: python -m bench.wizard_pictures [FOLDER]

Needs Chromium and playwright. Writes calibrate_1_rate to calibrate_6_check, and prints the
uncertainty of the landing that the page shows at each step.
"""

import argparse
from pathlib import Path
from typing import Any

from PIL import Image

from tests.pipelines.calibrate.wizard_page import chromium, fill, opened, settled, wizard

ROOT = Path(__file__).parents[1]
CLIP = ROOT / "sample_videos" / "clips" / "jokku_120.mp4"
SIZE, SHOWN_WIDTH = {"width": 1280, "height": 760}, 1000
ORIGIN_PX = (200.0, 100.0)


def spot(page: Any, x: float, y: float) -> tuple[float, float]:
    """Where a pixel of the clip is on the page."""
    box = page.locator("[data-test=picture]").bounding_box()
    scale = box["width"] / 640
    return box["x"] + (x + 0.5) * scale, box["y"] + (y + 0.5) * scale


def taken(page: Any, path: Path) -> None:
    """Write what the page shows."""
    settled(page)
    page.mouse.move(2, 2)
    page.screenshot(path=path)
    picture = Image.open(path).convert("RGB")
    picture = picture.resize((SHOWN_WIDTH, round(SHOWN_WIDTH * picture.height / picture.width)))
    picture.quantize(128, Image.Quantize.FASTOCTREE).save(path, optimize=True)
    print(path.name, page.inner_text("[data-test=std]"), flush=True)


def main() -> None:
    """Click through the wizard and write a picture of each step."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "docs" / "pictures")
    folder = parser.parse_args().folder
    # nothing is saved
    with wizard(CLIP, Path("setup.toml")) as running, chromium() as browser:
        page = opened(browser, running.address)
        page.set_viewport_size(SIZE)
        settled(page)
        fill(page, "fps", "600 fps")
        taken(page, folder / "calibrate_1_rate.png")
        page.click("[data-test=step-2]")
        taken(page, folder / "calibrate_2_lens.png")
        page.click("[data-test=step-3]")
        settled(page)
        page.click("[data-test=place-origin]")
        page.mouse.click(*spot(page, *ORIGIN_PX))
        taken(page, folder / "calibrate_3_wall.png")
        page.click("[data-test=step-4]")
        settled(page)
        page.click("[data-test=ball]")
        page.click(".q-menu >> text=jokku")
        taken(page, folder / "calibrate_4_ball.png")
        page.click("[data-test=step-5]")
        fill(page, "camera_distance", "4.6 m")
        fill(page, "ball_plane_offset", "0.45 m")
        taken(page, folder / "calibrate_5_distances.png")
        page.click("[data-test=step-6]")
        settled(page)
        page.click("text=Uncertainty map")
        taken(page, folder / "calibrate_6_check.png")


if __name__ == "__main__":
    main()
