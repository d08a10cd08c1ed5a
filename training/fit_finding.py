"""Fit the parameters of linking and selection to recordings with truth.

    python -m training.fit_finding STORE [--linking fitted] [--selection fitted] [--write]

STORE is a folder written by training.finding_data. Linking is fitted by maximum likelihood to the
detections that lie on bodies with known truth; selection is a conditional logit over the tracklets
of each recording, with a ridge that stands for a prior. Printed are the choices on recordings kept
out one at a time, and the reliability of the stated probabilities.
"""

import argparse
import json
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from training.finding_data import Recording
from vision.finding.linking import LinkParameters, Tracklet, link, link_parameters
from vision.finding.selection import FEATURES, tracklet_features

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Table = tuple[FloatArray, int]
"""Features of the tracklets of a recording, and which is right (their number: none)."""
PARAMETERS_FILE = Path("vision/finding/parameters.json")
_ON = 0.4
"""Radii, with one pixel more, within which a detection is of a body."""
_LONG = {"maxiter": 4000, "maxfev": 4000}
_MOVES = 0.02
"""Radii per frame from which a body counts as moving."""
_RIDGE = 0.05
"""Weight of the squared weights: a prior with a standard deviation of three for each."""


def rows_on(one: Recording, body: str) -> IntArray:
    """Rows of the detections that lie on a body, at most one a frame."""
    truth = one.bodies[body][np.searchsorted(one.frames, one.seen.frame)]
    away = np.hypot(*(one.seen.centre_px - truth[:, :2]).T)
    ratio = np.abs(np.log(one.seen.radius_px / truth[:, 2]))
    on = (away < _ON * truth[:, 2] + 1.0) & (ratio < 0.35)
    found = np.flatnonzero(on)
    order = found[np.lexsort((away[found], one.seen.frame[found]))]
    _, first = np.unique(one.seen.frame[order], return_index=True)
    return np.asarray(order[first])


@dataclass(frozen=True)
class Evidence:
    """What the detections on one body say on the parameters of linking.

    Attributes
    ----------
    speeds : (N, 3) array
        Displacement, radius, elapsed time of neighbouring rows in motion.
    turns : (N, 5) array
        Change of velocity, radius, elapsed and earlier time, and a weight: each body has the same.
    radii, colours : (N,) array
        Changes of the logarithm of the radius, and squared ones of the colour.
    gaps, missed, rows, frames : int
        Gaps, frames in them, detections, and frames from the first to the last.
    looks : (N, 5) array or None
        See `_looks_table`; with the first body of a recording, and if all its bodies are known.
    """

    speeds: FloatArray
    turns: FloatArray
    radii: FloatArray
    colours: FloatArray
    gaps: int
    missed: int
    rows: int
    frames: int
    looks: FloatArray | None


def evidence_of(one: Recording) -> list[Evidence]:
    """What each body of a recording says; none of those found in five frames or fewer."""
    found: list[Evidence] = []
    for body, places in one.bodies.items():
        rows = rows_on(one, body) if np.isfinite(places[:, 2]).any() else np.zeros(0, int)
        if len(rows) > 5:
            found.append(_evidence(one, body, rows, None if found else _looks_table(one)))
    return found


def _evidence(one: Recording, body: str, rows: IntArray, looks: FloatArray | None) -> Evidence:
    seen = one.seen.at(rows)
    place, frame = seen.centre_px, seen.frame.astype(float)
    step, time = np.diff(place, axis=0), np.diff(frame)
    size = 0.5 * (seen.radius_px[1:] + seen.radius_px[:-1])
    # at rest any scale fits: the rows in motion determine it
    near = (time <= 3) & (np.hypot(*step.T) > _MOVES * size * time)
    change = step[1:] / time[1:, None] - step[:-1] / time[:-1, None]
    turns = np.column_stack([np.hypot(*change.T), size[1:], time[1:], time[:-1]])
    turns = turns[near[1:] & near[:-1]]
    known = np.isfinite(one.bodies[body][:, 0])
    inside = known & (one.frames >= seen.frame[0]) & (one.frames <= seen.frame[-1])
    gaps = np.diff(np.flatnonzero(np.isin(one.frames[inside], seen.frame))) - 1
    return Evidence(
        np.column_stack([np.hypot(*step.T), size, time])[near],
        np.column_stack([turns, np.full(len(turns), 1.0 / max(len(turns), 1))]),
        np.diff(np.log(seen.radius_px)),
        (np.diff(seen.colour, axis=0) ** 2).sum(axis=1),
        int(np.count_nonzero(gaps)),
        int(gaps.sum()),
        len(rows),
        int(inside.sum()),
        looks,
    )


def _fit_turns(turns: FloatArray, start: FloatArray) -> FloatArray:
    """Scatter of a centre, px and radii, and scale and freedom of a change of velocity."""
    ratio = turns[:, 2] / turns[:, 3]
    share = 1.0 + (1.0 + ratio) ** 2 + ratio**2

    def cost(logs: FloatArray) -> float:
        place_px, place_radii, scale, freedom = np.exp(logs)
        pull = scale * turns[:, 1] * 0.5 * turns[:, 2] * (turns[:, 2] + turns[:, 3])
        wide = (place_px**2 + (place_radii * turns[:, 1]) ** 2) * share + pull**2
        off = (turns[:, 0] * turns[:, 2]) ** 2 / wide
        nats = 0.5 * (freedom + 2) * np.log1p(off / freedom) + np.log(wide)
        return float(np.sum(turns[:, 4] * nats))

    return np.exp(minimize(cost, np.log(start), method="Nelder-Mead", options=_LONG).x)


def _fit_scale(cost: Callable[[float], float], start: float) -> float:
    """The scale of least cost."""
    near = minimize(lambda log: cost(float(np.exp(log[0]))), [np.log(start)], method="Nelder-Mead")
    return float(np.exp(near.x[0]))


def fit_linking(evidence: list[Evidence], start: LinkParameters) -> LinkParameters:
    """Parameters of most likelihood, one group after the other."""
    turns = np.concatenate([one.turns for one in evidence])
    first = np.array([getattr(start, name) for name in _TURNS])
    place_px, place_radii, change, freedom = _fit_turns(turns, first).tolist()
    speeds = np.concatenate([one.speeds for one in evidence])
    still = 2.0 * (place_px**2 + (place_radii * speeds[:, 1]) ** 2)

    def speed_cost(scale: float) -> float:
        wide = still + (scale * speeds[:, 1] * speeds[:, 2]) ** 2
        return float(np.mean(1.5 * np.log1p(speeds[:, 0] ** 2 / wide) + np.log(wide)))

    def colour_cost(scale: float) -> float:
        tails = [2.0 * np.log1p(one.colours / scale**2).mean() for one in evidence]
        return float(np.mean(tails)) + 3.0 * float(np.log(scale + 10.0))

    gaps, missed = sum(one.gaps for one in evidence), sum(one.missed for one in evidence)
    looks = [one.looks for one in evidence if one.looks is not None]
    return LinkParameters(
        place_px=place_px,
        place_radii=place_radii,
        change_radii=change,
        change_freedom=freedom,
        speed_radii=_fit_scale(speed_cost, start.speed_radii),
        log_radius=float(np.sqrt(np.mean([np.mean(one.radii**2) for one in evidence]))),
        colour=_fit_scale(colour_cost, start.colour),
        missed=max(gaps, 1) / sum(one.frames for one in evidence),
        stays_missed=1.0 - gaps / max(missed, 1),
        begins=len(evidence) / sum(one.rows for one in evidence),
        looks=_looks(looks),
    )


_TURNS = ("place_px", "place_radii", "change_radii", "change_freedom")


def _looks(tables: list[FloatArray]) -> tuple[float, float, float]:
    """Weights of coverage and sharpness for an object against a false detection."""
    table = np.concatenate(tables)
    sign, weight = table[:, 3], table[:, 4] / len(tables)

    def cost(values: FloatArray) -> float:
        return float(np.sum(weight * np.logaddexp(0.0, -sign * (table[:, :3] @ values))))

    best = minimize(cost, np.array(link_parameters().looks), method="BFGS").x
    return float(best[0]), float(best[1]), float(best[2])


def _looks_table(one: Recording) -> FloatArray | None:
    """Coverage, sharpness, 1, whether it is an object, and a weight of each detection (N, 5)."""
    if not all(np.isfinite(places[:, 2]).any() for places in one.bodies.values()):
        return None
    on = np.zeros(len(one.seen), dtype=bool)
    for body in one.bodies:
        on[rows_on(one, body)] = True
    sharp = np.log(np.maximum(one.seen.sharpness, 1.0))
    # each recording has the same say, and object and clutter the same prior
    weight = np.where(on, 0.5 / max(on.sum(), 1), 0.5 / max((~on).sum(), 1))
    sign = np.where(on, 1.0, -1.0)
    return np.column_stack([one.seen.coverage, sharp, np.ones(len(on)), sign, weight])


def coverage(one: Recording, linking: LinkParameters) -> float | None:
    """Share of the detections on the measured body that one tracklet holds, less its strays."""
    on = rows_on(one, one.measured)
    if len(on) < 5:
        return None
    best, truth = 0.0, one.bodies[one.measured]
    for tracklet in link(one.seen, one.frames, one.shape, linking):
        places = truth[np.searchsorted(one.frames, tracklet.frame)]
        known = np.isfinite(places[:, 2])
        away = np.hypot(*(tracklet.centre_px - places[:, :2]).T)
        alike = np.abs(np.log(tracklet.seen.radius_px / places[:, 2])) < 0.35
        hit = known & (away < _ON * places[:, 2] + 1.0) & alike
        best = max(best, (hit.sum() - (known & ~hit).sum()) / len(on))
    return float(best)


def search_linking(store: list[Recording], start: LinkParameters, rounds: int) -> LinkParameters:
    """Improve the parameters one by one by what the best tracklets cover of the measured bodies.

    The likelihood leaves out that errors of neighbouring frames are alike and that recordings
    differ, so that its maximum is not where objects are followed best.
    """

    def score(parameters: LinkParameters) -> float:
        found = [coverage(one, parameters) for one in store]
        return float(np.mean([value for value in found if value is not None]))

    best, most = start, score(start)
    print(f"coverage {most:.3f}", flush=True)
    for _ in range(rounds):
        for name in start._fields:
            for factor in (0.7, 1.4):
                value = getattr(best, name)
                scaled = (
                    tuple(factor * each for each in value) if name == "looks" else factor * value
                )
                if name == "stays_missed":
                    scaled = min(scaled, 0.95)
                tried = best._replace(**{name: scaled})
                found = score(tried)
                if found > most:
                    best, most = tried, found
                    print(f"{name} {scaled}: {found:.3f}", flush=True)
    return best


def right_tracklet(one: Recording, tracklets: list[Tracklet]) -> int:
    """The tracklet that is the measured body; the number of tracklets where none is."""
    truth = one.bodies[one.measured]
    best, most = len(tracklets), 0.0
    usual = float(np.nanmedian(truth[:, 2]))
    for place, tracklet in enumerate(tracklets):
        places = truth[np.searchsorted(one.frames, tracklet.frame)]
        known = np.isfinite(places[:, 0])
        if not known.any():
            continue
        away = np.hypot(*(tracklet.centre_px[known] - places[known, :2]).T)
        radius = np.where(np.isfinite(places[known, 2]), places[known, 2], usual)
        on = away < 0.5 * radius + 1.0
        alike = abs(np.log(tracklet.radius / usual)) < 0.4 if np.isfinite(usual) else True
        count = float(np.count_nonzero(on)) * (np.mean(on) > 0.6) * alike
        if count > most:
            best, most = place, count
    return best


def fit_selection(tables: list[Table], start: FloatArray | None = None) -> FloatArray:
    """Weights of the conditional logit."""
    most = max(len(features) for features, _ in tables) + 1
    rows = np.zeros((len(tables), most, len(FEATURES) + 1))
    beyond = np.full((len(tables), most), -np.inf)
    for place, (features, _) in enumerate(tables):
        # after the tracklets comes "none", whose features are zero
        rows[place, : len(features)] = np.column_stack([features, np.ones(len(features))])
        beyond[place, : len(features) + 1] = 0.0
    right = rows[np.arange(len(tables)), [answer for _, answer in tables]]

    def cost(weights: FloatArray) -> tuple[float, FloatArray]:
        score = rows @ weights + beyond
        top = score.max(axis=1)
        share = np.exp(score - top[:, None])
        whole = share.sum(axis=1)
        total = 0.5 * _RIDGE * float(weights @ weights)
        total += float(np.sum(np.log(whole) + top - right @ weights))
        pull = np.einsum("km,kms->s", share / whole[:, None], rows)
        return total, _RIDGE * weights - right.sum(axis=0) + pull

    first = np.zeros(rows.shape[2]) if start is None else start
    return np.asarray(minimize(cost, first, jac=True, method="BFGS").x)


def stated(features: FloatArray, weights: FloatArray) -> FloatArray:
    """Probability of each tracklet, and of none."""
    score = np.append(features @ weights[:-1] + weights[-1], 0.0)
    share = np.exp(score - score.max())
    return np.asarray(share / share.sum())


def kept_out(tables: list[Table]) -> list[tuple[FloatArray, int]]:
    """Probabilities of each recording by a fit to the others, and the right choice."""
    weights = fit_selection(tables)
    return [
        (stated(features, fit_selection(tables[:place] + tables[place + 1 :], weights)), answer)
        for place, (features, answer) in enumerate(tables)
    ]


def report(names: list[str], tables: list[Table]) -> None:
    """Print the choices on recordings kept out one at a time, and the reliability."""
    judged = kept_out(tables)
    for name, (share, answer) in zip(names, judged, strict=True):
        choice, none = int(np.argmax(share)), len(share) - 1
        if choice != answer:
            right, chosen = ("none" if one == none else str(one) for one in (answer, choice))
            print(f"  {name}: {chosen} ({share[choice]:.2f}), right {right} ({share[answer]:.2f})")
    stated_at = np.array([share.max() for share, _ in judged])
    hit = np.array([share.argmax() == answer for share, answer in judged])
    loss = float(np.mean([-np.log(share[answer]) for share, answer in judged]))
    sure = stated_at >= 0.9
    print(f"right {hit.sum()} of {len(hit)}; log loss {loss:.3f};", end=" ")
    print(f"wrong at 0.90 or more {np.sum(~hit & sure)} of {np.sum(sure)}")


def resampled(count: int, draws: int) -> Iterator[IntArray]:
    """Places of recordings drawn with replacement."""
    rng = np.random.default_rng(43)
    for _ in range(draws):
        yield rng.integers(0, count, count)


def intervals(values: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Quantiles 0.025 and 0.975 of each parameter over the draws."""
    low, high = np.quantile(np.array(values), [0.025, 0.975], axis=0)
    return low, high


def _flat(linking: LinkParameters) -> FloatArray:
    return np.concatenate([np.atleast_1d(value) for value in linking])


def _entry(value: FloatArray, fit: FloatArray, low: FloatArray, high: FloatArray) -> dict[str, Any]:
    """Value in use, and the estimate with its 95 % interval; lists for several."""
    rows = {"value": value, "estimate": fit, "low": low, "high": high}
    return {name: np.round(np.squeeze(row), 5).tolist() for name, row in rows.items()}


def _linking_entries(
    used: LinkParameters, train: list[Recording], draws: int
) -> tuple[LinkParameters, dict[str, Any]]:
    """Estimates of the parameters of linking, and all of them with intervals."""
    own = [evidence_of(one) for one in train]
    fitted = fit_linking([each for one in own for each in one], used)
    drawn = [
        _flat(fit_linking([each for place in rows for each in own[place]], fitted))
        for rows in resampled(len(own), draws)
    ]
    low, high = intervals(drawn)
    entries, first = {}, 0
    for name, value in used._asdict().items():
        rows = slice(first, first + np.size(value))
        entries[name] = _entry(np.array(value), _flat(fitted)[rows], low[rows], high[rows])
        first = rows.stop
    return fitted, entries


def _selection_entries(tables: list[Table], used: FloatArray, draws: int) -> dict[str, Any]:
    """Weights of the selection in use, and estimates with intervals."""
    weights = fit_selection(tables)
    drawn = [
        fit_selection([tables[place] for place in rows], weights)
        for rows in resampled(len(tables), draws)
    ]
    low, high = intervals(drawn)
    return {
        name: _entry(used[k], weights[k], low[k], high[k])
        for k, name in enumerate((*FEATURES, "some"))
    }


def trains(place: int, name: str) -> bool:
    """Whether a recording is fitted to: all labs, and every second of the others."""
    return name.startswith(_LABS) or place % 2 == 0


_LABS = ("labs", "dev", "unseen")
"""Beginnings of the names of labs drawn at random."""


def main() -> None:
    """Fit, report, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--selection", choices=("kept", "fitted"), default="kept")
    parser.add_argument("--linking", choices=("kept", "fitted", "searched"), default="kept")
    parser.add_argument("--rounds", type=int, default=2, help="of the search")
    parser.add_argument("--draws", type=int, default=200, help="for the intervals")
    given = parser.parse_args()
    store = [pickle.loads(path.read_bytes()) for path in sorted(given.store.glob("*.pickle"))]
    train = [one for place, one in enumerate(store) if trains(place, one.name)]
    known = json.loads(PARAMETERS_FILE.read_text("utf-8"))
    used = link_parameters()
    fitted, entries = _linking_entries(used, train, given.draws)
    if given.linking != "kept":
        used = fitted
    if given.linking == "searched":
        used = search_linking(train, fitted, given.rounds)
    for name, entry in entries.items():
        entry["value"] = np.round(getattr(used, name), 5).tolist()
        print(f"{name}: {entry}", flush=True)
    names, tables = [one.name for one in store], []
    for one in store:
        tracklets = link(one.seen, one.frames, one.shape, used)
        features = tracklet_features(tracklets, len(one.frames), one.shape)
        tables.append((features, right_tracklet(one, tracklets)))
    print("no right tracklet:", [n for n, (f, r) in zip(names, tables, strict=True) if r == len(f)])
    report(names, tables)
    own = [table for k, table in enumerate(tables) if trains(k, names[k])]
    known |= {"linking": entries, "recordings": len(own)}
    kept = {name: entry["value"] for name, entry in known["selection"].items()}
    weights = np.array([kept.get(name, 0.0) for name in (*FEATURES, "some")])
    if given.selection == "fitted":
        weights = fit_selection(own)
    known["selection"] = _selection_entries(own, weights, given.draws)
    for name, entry in known["selection"].items():
        print(f"{name}: {entry}")
    if given.write:
        PARAMETERS_FILE.write_text(json.dumps(known, indent=2) + "\n", "utf-8")


if __name__ == "__main__":
    main()
