"""Fit the parameters of linking and selection to recordings with truth.

    python -m training.fit_finding STORE [--rounds N] [--write]

STORE is a folder written by training.finding_data. Linking is fitted by maximum likelihood to the
detections that lie on bodies with known truth; selection is a conditional logit over the tracklets
of each recording, with a ridge that stands for a prior. Printed are the choices on recordings kept
out one at a time, and the reliability of the stated probabilities.
"""

import argparse
import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from training.finding_data import Recording
from vision.finding.linking import LinkParameters, Tracklet, link
from vision.finding.selection import FEATURES, tracklet_features

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
PARAMETERS = Path("vision/finding/parameters.json")
_ON = 0.4
"""Radii, with one pixel more, within which a detection is of a body."""
_LONG = {"maxiter": 4000, "maxfev": 4000}
_MOVES = 0.02
"""Radii per frame from which a body counts as moving."""
_USUAL_TO_WORST = 0.84
"""Quantile over recordings of a scatter: one standard deviation above the median."""
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


def chains_of(store: list[Recording]) -> list[tuple[Recording, str, IntArray]]:
    """Detections on each body whose radius is known."""
    return [
        (one, body, rows)
        for one in store
        for body, places in one.bodies.items()
        if np.isfinite(places[:, 2]).any() and len(rows := rows_on(one, body)) > 5
    ]


def _steps(
    chains: list[tuple[Recording, str, IntArray]],
) -> tuple[FloatArray, FloatArray]:
    """Displacements and times of neighbouring rows; changes, radii, elapsed and earlier times."""
    first, second = [], []
    for one, _, rows in chains:
        place, frame = one.seen.centre_px[rows], one.seen.frame[rows].astype(float)
        radius = one.seen.radius_px[rows]
        step, time = np.diff(place, axis=0), np.diff(frame)
        size = 0.5 * (radius[1:] + radius[:-1])
        # at rest any scale fits: what moves tells it
        near = (time <= 3) & (np.hypot(*step.T) > _MOVES * size * time)
        first.append(np.column_stack([np.hypot(*step.T), size, time])[near])
        change = step[1:] / time[1:, None] - step[:-1] / time[:-1, None]
        both = near[1:] & near[:-1]
        table = np.column_stack([np.hypot(*change.T), size[1:], time[1:], time[:-1]])[both]
        # each recording has the same say
        second.append(np.column_stack([table, np.full(len(table), 1.0 / max(len(table), 1))]))
    return np.concatenate(first), np.concatenate(second)


def fit_linking(store: list[Recording]) -> LinkParameters:
    """Parameters of the linking likelihood, one group after the other."""
    chains = chains_of(store)
    first, second = _steps(chains)
    ratio = second[:, 2] / second[:, 3]
    share = 1.0 + (1.0 + ratio) ** 2 + ratio**2

    def change_cost(logs: FloatArray) -> float:
        place_px, place_radii, scale, freedom = np.exp(logs)
        pull = scale * second[:, 1] * 0.5 * second[:, 2] * (second[:, 2] + second[:, 3])
        wide = (place_px**2 + (place_radii * second[:, 1]) ** 2) * share + pull**2
        off = (second[:, 0] * second[:, 2]) ** 2 / wide
        nats = 0.5 * (freedom + 2) * np.log1p(off / freedom) + np.log(wide)
        return float(np.sum(second[:, 4] * nats))

    start = np.array([-1.5, -4.0, -4.0, 0.5])
    change = np.exp(minimize(change_cost, start, method="Nelder-Mead", options=_LONG).x)
    place_px, place_radii = float(change[0]), float(change[1])
    still = 2.0 * (place_px**2 + (place_radii * first[:, 1]) ** 2)

    def speed_cost(logs: FloatArray) -> float:
        wide = still + (np.exp(logs[0]) * first[:, 1] * first[:, 2]) ** 2
        return float(np.mean(1.5 * np.log1p(first[:, 0] ** 2 / wide) + np.log(wide)))

    speed = float(np.exp(minimize(speed_cost, [-2.0], method="Nelder-Mead").x[0]))
    sizes, colours, missed, runs, length = [], [], [0, 0], [0, 0], []
    for one, body, rows in chains:
        seen = one.seen.at(rows)
        sizes.append(np.diff(np.log(seen.radius_px)))
        colours.append((np.diff(seen.colour, axis=0) ** 2).sum(axis=1))
        known = np.isfinite(one.bodies[body][:, 0])
        inside = known & (one.frames >= seen.frame[0]) & (one.frames <= seen.frame[-1])
        missed[0] += int(inside.sum()) - len(rows)
        missed[1] += int(inside.sum())
        gaps = np.diff(np.flatnonzero(np.isin(one.frames[inside], seen.frame))) - 1
        runs[0] += int(np.count_nonzero(gaps))
        runs[1] += int(gaps.sum())
        length.append(len(rows))
    # each recording has its own scatter; the likelihood has one that allows for most of them
    colour = float(np.quantile([np.sqrt(np.mean(one)) for one in colours], _USUAL_TO_WORST))
    spread = float(np.quantile([np.std(one) for one in sizes], _USUAL_TO_WORST))
    return LinkParameters(
        place_px,
        place_radii,
        float(change[2]),
        float(change[3]),
        speed,
        spread,
        colour,
        max(runs[0], 1) / missed[1],
        1.0 - runs[0] / max(runs[1], 1),
        len(length) / sum(length),
        _looks(store),
    )


def _looks(store: list[Recording]) -> tuple[float, float, float]:
    """Nats of coverage and sharpness for an object against a false detection."""
    tables, labels, weights = [], [], []
    for one in store:
        if not all(np.isfinite(places[:, 2]).any() for places in one.bodies.values()):
            continue
        on = np.zeros(len(one.seen), dtype=bool)
        for body in one.bodies:
            on[rows_on(one, body)] = True
        sharp = np.log(np.maximum(one.seen.sharpness, 1.0))
        tables.append(np.column_stack([one.seen.coverage, sharp, np.ones(len(on))]))
        labels.append(on)
        # each recording has the same say, and object and clutter the same prior
        share = np.where(on, 0.5 / max(on.sum(), 1), 0.5 / max((~on).sum(), 1))
        weights.append(share)
    table, label = np.concatenate(tables), np.concatenate(labels)
    sign, weight = np.where(label, 1.0, -1.0), np.concatenate(weights) / len(weights)

    def cost(values: FloatArray) -> float:
        score = table @ values
        return float(np.sum(weight * np.logaddexp(0.0, -sign * score)))

    best = minimize(cost, np.zeros(3), method="BFGS").x
    return float(best[0]), float(best[1]), float(best[2])


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
        for name in vars(start):
            for factor in (0.7, 1.4):
                value = getattr(best, name)
                scaled = (
                    tuple(factor * each for each in value) if name == "looks" else factor * value
                )
                if name == "stays_missed":
                    scaled = min(scaled, 0.95)
                tried = replace(best, **{name: scaled})
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


def fit_selection(
    tables: list[tuple[FloatArray, int]], start: FloatArray | None = None
) -> FloatArray:
    """Weights of the conditional logit."""
    size = len(FEATURES) + 1

    def cost(weights: FloatArray) -> tuple[float, FloatArray]:
        total = 0.5 * _RIDGE * float(weights @ weights)
        slope = _RIDGE * weights
        for features, right in tables:
            table = np.vstack([np.column_stack([features, np.ones(len(features))]), np.zeros(size)])
            score = table @ weights
            share = np.exp(score - score.max())
            share /= share.sum()
            total -= np.log(share[right])
            slope = slope - table[right] + share @ table
        return total, slope

    first = np.zeros(size) if start is None else start
    return np.asarray(minimize(cost, first, jac=True, method="BFGS").x)


def stated(features: FloatArray, weights: FloatArray) -> FloatArray:
    """Probability of each tracklet, and of none."""
    score = np.append(features @ weights[:-1] + weights[-1], 0.0)
    share = np.exp(score - score.max())
    return np.asarray(share / share.sum())


def report(names: list[str], tables: list[tuple[FloatArray, int]], weights: FloatArray) -> None:
    """Print the choices on recordings kept out one at a time, and the reliability."""
    probability, right, loss = [], [], []
    for place, (features, answer) in enumerate(tables):
        kept = tables[:place] + tables[place + 1 :]
        share = stated(features, fit_selection(kept, weights))
        choice = int(np.argmax(share))
        probability.append(share[choice])
        right.append(choice == answer)
        loss.append(-np.log(share[answer]))
        if choice != answer:
            what = "none" if answer == len(features) else f"{answer} ({share[answer]:.2f})"
            chosen = "none" if choice == len(features) else str(choice)
            print(f"  {names[place]}: {chosen} ({share[choice]:.2f}), right is {what}")
    stated_at, hit = np.array(probability), np.array(right)
    print(f"right {hit.sum()} of {len(hit)}; log loss {np.mean(loss):.3f};", end=" ")
    sure = stated_at >= 0.9
    print(f"wrong at 0.90 or more {np.sum(~hit & sure)} of {np.sum(sure)}")
    for low, high in ((0.0, 0.5), (0.5, 0.75), (0.75, 0.9), (0.9, 0.97), (0.97, 1.01)):
        rows = (stated_at >= low) & (stated_at < high)
        if rows.any():
            mean, share = stated_at[rows].mean(), hit[rows].mean()
            print(f"  stated {mean:.2f}, right {share:.2f} ({rows.sum()})")


def main() -> None:
    """Fit, report, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--keep-linking", action="store_true")
    parser.add_argument("--rounds", type=int, default=0, help="of the search for better tracklets")
    given = parser.parse_args()
    store = [pickle.loads(path.read_bytes()) for path in sorted(given.store.glob("*.pickle"))]
    known = json.loads(PARAMETERS.read_text("utf-8"))
    if given.keep_linking:
        values = {name: each["value"] for name, each in known["linking"].items()}
        linking = LinkParameters(**{**values, "looks": tuple(values["looks"])})
    else:
        linking = fit_linking(store)
    if given.rounds:
        linking = search_linking(store, linking, given.rounds)
    print(linking)
    names, tables = [], []
    for one in store:
        tracklets = link(one.seen, one.frames, one.shape, linking)
        if not tracklets:
            print(one.name, "no tracklet")
            continue
        names.append(one.name)
        features = tracklet_features(tracklets, len(one.frames), one.shape)
        tables.append((features, right_tracklet(one, tracklets)))
    print("no right tracklet:", [n for n, (f, r) in zip(names, tables, strict=True) if r == len(f)])
    weights = fit_selection(tables)
    print(dict(zip((*FEATURES, "some"), np.round(weights, 2).tolist(), strict=True)))
    report(names, tables, weights)
    if given.write:
        known["linking"] = {
            name: {"value": np.round(value, 5).tolist()} for name, value in vars(linking).items()
        }
        known["selection"] = {
            name: {"value": round(value, 4)}
            for name, value in zip((*FEATURES, "some"), weights.tolist(), strict=True)
        }
        PARAMETERS.write_text(json.dumps(known, indent=2) + "\n", "utf-8")


if __name__ == "__main__":
    main()
