"""A wrong input is found with its value; right ones are not blamed."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib.grid import GridMap, WallGrid
from measuring.checker.balance import Input, Relation, weigh
from measuring.checker.scene import Finding, SceneFacts, findings_of

G = 9.81


@dataclass(frozen=True)
class Lab:
    """What is true of a filmed throw."""

    fps: float = 600.0
    diameter: float = 0.2018
    pitch: float = 0.05
    scale: float = 1.0 / 73.4
    far: float = 4.6
    near: float = 0.45
    seed: int = 0

    def grid(self, stated: float) -> WallGrid:
        """Lines of the wall, `pitch` apart, entered as `stated`."""
        per_node = self.pitch / (self.scale / (1.0 - self.near / self.far))
        flat = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        grid_map = GridMap(np.zeros(2), np.full(2, per_node), flat)
        none = np.zeros((0, 2))
        return WallGrid(
            size=(432, 240),
            pitch_m=stated,
            nodes=np.zeros((0, 2), dtype=np.int64),
            points_px=none,
            covariance_px2=np.zeros((0, 2, 2)),
            map=grid_map,
            area=np.ones((240, 432), dtype=bool),
            dark=True,
            fine_ratio=None,
            origin_m=np.zeros(2),
        )

    def facts(self) -> SceneFacts:
        """All stated correctly."""
        rng = np.random.default_rng(self.seed)
        frame = np.arange(int(0.4 * self.fps), dtype=float)
        time = frame / self.fps
        fall = np.column_stack([4.5 * time, -(1.0 * time - 0.5 * G * time**2)]) / self.scale
        radius = 0.5 * self.diameter / self.scale
        return SceneFacts(
            frame=frame,
            centre_px=100.0 + fall + rng.normal(0.0, 0.05, fall.shape),
            radius_px=radius + rng.normal(0.0, 0.1, len(frame)),
            flies=True,
            rate=(self.fps, 3e-4 * self.fps),
            ball=(self.diameter, 0.002),
            grid=self.grid(self.pitch),
            camera_distance=(self.far, 0.01),
            plane_offset=(self.near, 0.01),
        )


def only(findings: tuple[Finding, ...]) -> Finding:
    (one,) = findings
    return one


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("fps", [120.0, 600.0])
def test_what_fits_is_not_blamed(fps: float, seed: int) -> None:
    lab = Lab(fps=fps, seed=seed)
    facts = lab.facts()
    assert findings_of(facts) == ()
    for unknown in ("rate", "ball", "grid", "camera_distance"):
        assert findings_of(replace(facts, **{unknown: None})) == ()
    assert findings_of(replace(facts, radius_px=None)) == ()
    assert findings_of(replace(facts, flies=False)) == ()


@pytest.mark.parametrize("wrong", [30.0, 240.0, 300.0, 1200.0])
def test_a_wrong_rate(wrong: float) -> None:
    found = only(findings_of(replace(Lab().facts(), rate=(wrong, 0.1))))
    assert (found.key, found.option) == ("rate", "--fps 600")
    assert abs(found.value - 600.0) < 3.0 * found.std
    assert "Likely cause: the capture rate" in found.sentence
    assert "--fps 600" in found.sentence


@pytest.mark.parametrize(
    ("wrong", "slip"), [(0.246, ""), (0.1009, "radius"), (0.634, "circumference")]
)
def test_a_wrong_ball(wrong: float, slip: str) -> None:
    found = only(findings_of(replace(Lab().facts(), ball=(wrong, 0.002))))
    assert found.key == "ball"
    assert abs(found.value - 0.2018) < 3.0 * found.std
    assert found.option.startswith("--ball 20")
    assert slip in found.sentence


@pytest.mark.parametrize("wrong", [0.01, 0.04, 0.1])
def test_a_wrong_grid(wrong: float) -> None:
    lab = Lab()
    found = only(findings_of(replace(lab.facts(), grid=lab.grid(wrong))))
    assert (found.key, found.option) == ("grid", "--wall-grid 50mm")
    assert abs(found.value - 0.05) < 3.0 * found.std


@pytest.mark.parametrize("wrong", [0.04, 0.1])
def test_a_wrong_grid_without_distances(wrong: float) -> None:
    lab = Lab()
    facts = replace(lab.facts(), camera_distance=None, plane_offset=None)
    assert findings_of(facts) == ()
    found = only(findings_of(replace(facts, grid=lab.grid(wrong))))
    assert "--wall-grid" in found.sentence


@pytest.mark.parametrize("near", [0.05, 1.5])
def test_a_ball_plane_of_unknown_depth_is_not_blamed(near: float) -> None:
    facts = replace(Lab(near=near).facts(), camera_distance=None, plane_offset=None)
    assert findings_of(facts) == ()


def test_a_wrong_scale() -> None:
    lab = Lab()
    facts = replace(lab.facts(), grid=None, scale=(lab.scale * 10.0, 1e-3 * lab.scale))
    found = only(findings_of(facts))
    assert found.key == "scale"
    assert abs(found.value - lab.scale) < 3.0 * found.std
    assert "--scale" in found.option


def test_two_inputs_that_can_not_be_told_apart_are_both_named() -> None:
    facts = replace(Lab().facts(), grid=None, rate=(300.0, 0.1))
    found = only(findings_of(facts))
    assert "--fps 600" in found.sentence
    assert "--ball" in found.sentence
    # the usual value comes first
    assert found.sentence.index("--fps 600") < found.sentence.index("--ball")


def test_two_wrong_inputs_are_not_explained_by_one() -> None:
    lab = Lab()
    facts = replace(lab.facts(), ball=(0.1, 0.001), grid=lab.grid(0.1), rate=(150.0, 0.1))
    found = only(findings_of(replace(facts, scale=(3.0 * lab.scale, 1e-3 * lab.scale))))
    assert found.key == "several"
    assert "--fps" in found.sentence


def test_missing_facts_are_named_with_what_was_seen() -> None:
    facts = replace(Lab().facts(), rate=None, ball=None, grid=None)
    found = only(findings_of(facts))
    assert found.key == "facts"
    assert "--fps" in found.sentence
    assert "--ball" in found.sentence
    assert "15 px wide" in found.sentence
    acceleration = G / Lab().scale / 600.0**2
    assert f"{acceleration:.2g}"[:4] in found.sentence


def test_an_input_is_estimated_from_the_others() -> None:
    inputs = [Input("a", 2.0, 0.01), Input("b", 3.0, 0.01), Input("c", 12.0, 0.01)]
    relations = [
        Relation("product", {"a": 1.0, "b": 1.0, "x": -1.0}, 1.0, 0.01),
        Relation("same", {"c": 1.0, "x": -1.0}, 1.0, 0.01),
        Relation("ratio", {"b": 1.0, "a": -1.0}, 1.5, 0.01),
    ]
    found = weigh(inputs, relations)
    assert found is not None
    (cause,) = found.causes
    assert cause.key == "c"
    assert cause.value == pytest.approx(6.0, rel=1e-6)
    assert cause.std / cause.value == pytest.approx(math.sqrt(5e-4), rel=0.3)
    assert weigh(inputs[:2], relations) is None


def thrown(lab: Lab, drag: float, speed: float) -> np.ndarray:
    """Positions in metres, y up, of a ball thrown at 45° through air."""
    step, place = 1.0 / lab.fps / 20, np.zeros(2)
    velocity, path = np.array([speed, speed]) / math.sqrt(2.0), []
    for number in range(int(0.4 * lab.fps) * 20):
        if number % 20 == 0:
            path.append(place.copy())
        pull = -drag * np.hypot(*velocity) * velocity - np.array([0.0, G])
        velocity = velocity + pull * step
        place = place + velocity * step
    return np.array(path)


@pytest.mark.parametrize("drag", [0.02, 0.05])
def test_the_drag_of_the_air_is_no_contradiction(drag: float) -> None:
    lab = Lab()
    facts = lab.facts()
    px = 100.0 + thrown(lab, drag, 9.0) / lab.scale * [1.0, -1.0]
    facts = replace(facts, centre_px=px + np.random.default_rng(1).normal(0.0, 0.05, px.shape))
    assert findings_of(replace(facts, drag=(drag, 0.2 * drag))) == ()
    if drag > 0.03:
        assert findings_of(facts)


@pytest.mark.parametrize(
    ("drag", "speed", "wrong"), [(0.02, 9.0, 0.246), (0.04, 6.0, 0.27), (0.06, 4.0, 0.3)]
)
def test_a_wrong_ball_that_the_air_slows(drag: float, speed: float, wrong: float) -> None:
    lab = Lab()
    facts = lab.facts()
    px = 100.0 + thrown(lab, drag, speed) / lab.scale * [1.0, -1.0]
    px = px + np.random.default_rng(1).normal(0.0, 0.05, px.shape)
    # drag is taken of the ball that was stated
    taken = drag * (wrong / lab.diameter) ** 2
    facts = replace(facts, centre_px=px, ball=(wrong, 0.002), drag=(taken, 0.05 * taken))
    found = only(findings_of(facts))
    assert found.key == "ball"
    assert abs(found.value - lab.diameter) < 2.0 * found.std


def test_a_fitted_fall_takes_the_place_of_the_track_s_parabola() -> None:
    lab = Lab()
    facts = lab.facts()
    size = G / lab.scale / lab.fps**2
    # perspective and air bend the path by a tenth more
    bent = replace(facts, centre_px=facts.centre_px + 0.05 * size * facts.frame[:, None] ** 2)
    assert findings_of(bent) != ()
    assert findings_of(replace(bent, fall=(size, 0.01 * size))) == ()
    short = replace(bent, fall=(size, 0.01 * size), camera_distance=(2.2, 0.01))
    found = only(findings_of(short))
    (ratio,) = (text for text in found.sentence.split(";") if "distance_to_wall" in text)
    assert 4.0 < float(ratio.split('distance_to_wall = "')[1].split()[0]) < 5.2


def test_a_slanted_view_is_no_contradiction() -> None:
    lab = Lab()
    facts = lab.facts()
    assert facts.grid is not None
    # a homography that halves the scale over the picture
    slope = -0.5 / 432.0
    flat = facts.grid.map
    tilted = replace(flat, parameters=flat.parameters + np.eye(10)[6] * slope * flat.scale[0])
    wall = flat(facts.centre_px)
    seen = tilted.inverse(wall, facts.centre_px)
    size = np.linalg.det(flat.jacobian(facts.centre_px)) / np.linalg.det(tilted.jacobian(seen))
    assert facts.radius_px is not None
    grid = replace(facts.grid, map=tilted)
    slanted = replace(facts, centre_px=seen, radius_px=facts.radius_px * np.sqrt(size), grid=grid)
    # the distances of this camera are not known
    slanted = replace(slanted, camera_distance=None, plane_offset=None)
    assert findings_of(slanted) == ()
    assert findings_of(replace(slanted, grid=replace(grid, pitch_m=0.1)))


def test_a_value_between_usual_ones_is_the_last_explanation() -> None:
    lab = Lab()
    found = only(findings_of(replace(lab.facts(), camera_distance=(2.9, 0.005))))
    assert found.key == "ratio"
    likely, unlikely = found.sentence.split("Less likely")
    assert "distance_to_wall" in likely
    assert "--wall-grid" in unlikely
