"""The pictures of docs/campaign.md, from the campaign that `bench.campaign.filmed` left.

``python -m bench.campaign.pictures FOLDER [--out docs/pictures]`` needs Chromium.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image

_SERVE = """
import sys
from pathlib import Path
from pipelines.campaign.watch import watched
page = watched(Path(sys.argv[1]), lambda address: print(address, flush=True), browse=False)
page.closed.wait()
"""
COLOURS = 128
"""A page has few: a palette makes its picture a third as large."""


def small(path: Path, width: int) -> None:
    """Shrink a picture in place."""
    with Image.open(path) as picture:
        size = (width, round(picture.height * width / picture.width))
        shrunk = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    shrunk.quantize(COLOURS).save(path, optimize=True)


def main() -> None:
    """Photograph page and report, and take the figure of the law."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(prog="python -m bench.campaign.pictures", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/pictures"))
    given = parser.parse_args()
    campaign = (given.folder / "campaign").resolve()
    page_process = subprocess.Popen(
        [sys.executable, "-c", _SERVE, str(campaign)], stdout=subprocess.PIPE, text=True
    )
    address = page_process.stdout.readline().strip()
    shots = (
        ("campaign_watch", address, 760),
        ("campaign_report", (campaign / "report.html").as_uri(), 1240),
    )
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        for name, url, height in shots:
            page = browser.new_page(viewport={"width": 1200, "height": height})
            page.goto(url)
            page.wait_for_timeout(3000)
            page.screenshot(path=given.out / f"{name}.png")
            page.close()
        browser.close()
    page_process.kill()
    shutil.copy(campaign / "figures" / "cor.png", given.out / "campaign_cor.png")
    for name, width in (("campaign_watch", 900), ("campaign_report", 800), ("campaign_cor", 800)):
        small(given.out / f"{name}.png", width)


if __name__ == "__main__":
    main()
