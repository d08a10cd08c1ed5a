"""Draw what each of the four stages finds in a clip, for the page on how it is built.

Run: python docs/stages.py

Writes docs/pictures/stage_1_detect.png to stage_4_refine.png.
"""

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import vision
from vision.clip.clip import ClipReader

HERE = Path(__file__).parent
CLIP = HERE.parent / "sample_videos" / "clips" / "jokku_120.mp4"
FRAME = 205
"""Frame shown; chosen: the ball flies, and the mass follows."""
ZOOM = 2
COLOURS = [(0, 90, 220), (200, 90, 0), (30, 150, 30), (150, 30, 150), (90, 90, 90)]


def _picture(index: int) -> np.ndarray:
    _, image = next(iter(ClipReader.open(CLIP).colour_frames(index, index + 1)))
    return np.asarray(cv2.resize(image, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_CUBIC))


def _at(row: object, names: tuple[str, str] = ("x_px", "y_px")) -> tuple[int, int]:
    return round(ZOOM * row[names[0]]), round(ZOOM * row[names[1]])  # type: ignore[index]


def _save(image: np.ndarray, name: str) -> None:
    picture = Image.fromarray(image[:, :, ::-1]).quantize(128, Image.Quantize.FASTOCTREE)
    picture.save(HERE / "pictures" / f"{name}.png", optimize=True)


def main() -> None:
    """Write the four pictures."""
    detections = vision.detect(CLIP)
    image = _picture(FRAME)
    for _, row in detections[detections["frame"] == FRAME].iterrows():
        cv2.circle(image, _at(row), round(ZOOM * row["radius_px"]), COLOURS[0], 2, cv2.LINE_AA)
    _save(image, "stage_1_detect")
    tracklets = vision.link(detections)
    image = _picture(FRAME)
    for number, rows in tracklets.groupby("tracklet"):
        points = np.array([_at(row) for _, row in rows.iterrows()], dtype=np.int32)
        cv2.polylines(image, [points], False, COLOURS[int(number) % 5], 2, cv2.LINE_AA)
    _save(image, "stage_2_link")
    order = vision.interpret(tracklets)
    image = _picture(FRAME)
    for _, row in order.head(4).iterrows():
        rows = tracklets[tracklets["tracklet"] == row["tracklet"]]
        near = rows.iloc[(rows["frame"] - FRAME).abs().argmin()]
        cv2.circle(image, _at(near), round(ZOOM * near["radius_px"]), COLOURS[0], 2, cv2.LINE_AA)
        text, place = f"{row['probability']:.2f}", _at(near)
        cv2.putText(image, text, (place[0] + 12, place[1] - 12), 0, 0.6, COLOURS[0], 2, cv2.LINE_AA)
    _save(image, "stage_3_interpret")
    fitted = vision.refine(CLIP, tracklets, int(order["tracklet"][0]))
    image = _picture(FRAME)
    points = np.array([_at(row) for _, row in fitted.iterrows()], dtype=np.int32)
    cv2.polylines(image, [points], False, COLOURS[2], 1, cv2.LINE_AA)
    row = fitted[fitted["frame"] == FRAME].iloc[0]
    cv2.circle(image, _at(row), round(ZOOM * row["radius_px"]), COLOURS[0], 1, cv2.LINE_AA)
    _save(image, "stage_4_refine")


if __name__ == "__main__":
    main()
