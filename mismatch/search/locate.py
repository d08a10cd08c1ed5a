"""Locate a mismatch: phase, time and direction; test what remains after a fit."""

from dataclasses import dataclass

import numpy as np

from mismatch.fitting.fit import Fit, fit_model, spread_laws
from mismatch.fitting.hypotheses import Hypothesis
from mismatch.fitting.prepare import Prepared
from mismatch.forward import Forward
from mismatch.records import CampaignRecords, whiteness
from mismatch.verdict import Location, Remainder
from physics.domain import FloatArray
from physics.effects import Effect, EffectId, FlightState, SwingState, Values

__all__ = [
    "flight_state",
    "locate",
    "noise_notes",
    "remainder_of",
    "swing_state",
    "where_it_is_largest",
]

FELT = 0.1

"""Share of its largest force from which on a force is said to act."""

FELT_LOCALLY = 0.45

"""As `FELT`, for gusts and places: a window's edges are where it is half as strong, and a pull
towards a point is so strong two of its widths away."""

LOCAL = frozenset({"middle", "place", "place_x"})

"""Shapes that bind a force to a time or a place."""

CHANNELS = ("x", "y", "z", "angle")


@dataclass(frozen=True)
class Scanned:
    """Strongest run of one-sided residuals.

    Attributes
    ----------
    score : float
        Standardised sum over the window.
    significant : bool
        At one per cent for all windows and channels together.
    start, end : float
        s after first touch.
    channel : str
        x, y, z or angle.
    """

    score: float
    significant: bool
    start: float
    end: float
    channel: str


def _since(forward: Forward, fit: Fit) -> tuple[FloatArray, FloatArray]:
    records = forward.records
    if forward.mode == "impact":
        clock = fit.nuisance[:, :1]
        return records.ball_time - clock, records.pendulum_time - clock
    return (
        records.ball_time - records.ball_time[:, :1],
        records.pendulum_time - records.pendulum_time[:, :1],
    )


def scan_windows(forward: Forward, fit: Fit, bins: int = 24, draws: int = 400) -> Scanned:
    """Scan statistic over time windows, all trials added, with family-wise error control.

    Residuals of each channel are summed in even time bins over all trials; every window of bins is
    scored by its standardised sum, and the largest score is held against that of residuals whose
    signs are drawn anew per trial and bin.
    """
    ball, swing = _since(forward, fit)
    s = ball.shape[1]
    used = forward.records.used
    rng = np.random.default_rng(7)
    sums = []
    for channel in range(4):
        time = swing if channel == 3 else ball
        at = slice(channel * s, (channel + 1) * s) if channel < 3 else slice(3 * s, None)
        mask = used[:, at]
        if not mask.any():
            continue
        edges = np.linspace(float(time[mask].min()), float(time[mask].max()) + 1e-9, bins + 1)
        place = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, bins - 1)
        table = np.zeros((time.shape[0], bins))
        count = np.zeros((time.shape[0], bins))
        rows = np.broadcast_to(np.arange(time.shape[0])[:, None], time.shape)
        np.add.at(table, (rows[mask], place[mask]), fit.residual[:, at][mask])
        np.add.at(count, (rows[mask], place[mask]), 1.0)
        sums.append((channel, table / np.sqrt(np.maximum(count, 1.0)), edges))
    best: tuple[float, int, int, int, FloatArray] = (0.0, 0, 0, 0, np.zeros(1))
    null = np.zeros(draws)
    for channel, table, edges in sums:
        score, i, j = _largest(table.sum(axis=0)[None] / np.sqrt(table.shape[0]))
        if score[0] > best[0]:
            best = (float(score[0]), channel, int(i[0]), int(j[0]), edges)
        spread = max(float(np.sqrt(np.mean(table**2))), 1.0)
        noise = rng.standard_normal((draws, bins)) * spread
        null = np.maximum(null, _largest(noise)[0])
    level = float(np.quantile(null, 0.99)) if sums else np.inf
    score0, where, first, last, edges = best
    if edges.size < 2:
        return Scanned(0.0, False, 0.0, 0.0, "x")
    low_t, high_t = float(edges[first]), float(edges[last])
    return Scanned(score0, score0 > level, low_t, high_t, CHANNELS[where])


def _largest(bins: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Largest standardised window sum of each row of (n, bins), and where."""
    total = np.concatenate([np.zeros((bins.shape[0], 1)), np.cumsum(bins, axis=1)], axis=1)
    best = np.zeros(bins.shape[0])
    first, last = np.zeros(bins.shape[0]), np.zeros(bins.shape[0])
    for i in range(bins.shape[1]):
        for j in range(i + 1, bins.shape[1] + 1):
            score = np.abs(total[:, j] - total[:, i]) / np.sqrt(j - i)
            better = score > best
            best = np.where(better, score, best)
            first, last = np.where(better, i, first), np.where(better, j, last)
    return best, first, last


def _values_of(fit: Fit, effect: Effect) -> Values:
    return next(values for held, values in fit.model.entries if held is effect)


def flight_state(forward: Forward, fit: Fit) -> tuple[FlightState, FloatArray]:
    """The balls' states at their rows (T, S), as a fit has them, and their time since touch, s."""
    records = forward.records
    nuisance = spread_laws(forward, fit.model, fit.nuisance, fit.law_offsets)[None]
    # Two predictions at clocks a little apart give the velocity that goes with each row.
    step = 1e-4
    predicted = forward.predict([fit.model], nuisance)[0]
    s = records.ball_time.shape[1]
    ball, _ = _since(forward, fit)
    place = np.stack([predicted[:, k * s : (k + 1) * s] for k in range(3)])
    later = forward.predict([fit.model], _later(forward, nuisance, step))[0]
    moved = np.stack([later[:, k * s : (k + 1) * s] for k in range(3)])
    velocity = (moved - place) / step
    base = forward.baseline
    gap = _release(forward, fit)
    flight = FlightState(
        ball - gap, place[0], place[1], place[2], velocity[0], velocity[1], velocity[2],
        records.mass[:, None], records.diameter[:, None],
        base.air_density, base.air_viscosity, base.gravity,
        fit.model.value("drag", "drag_coefficient", 0.0), fit.model.value("magnus", "spin", 0.0),
        forward.nominal_speed()[:, None], records.order[:, None],
    )  # fmt: skip
    return flight, ball


def swing_state(forward: Forward, fit: Fit) -> SwingState | None:
    """The pendulum's states at its rows (T, P), as a fit has them; None without a pendulum."""
    body = forward.baseline.pendulum
    records = forward.records
    if body is None or not records.pendulum_used.any():
        return None
    nuisance = spread_laws(forward, fit.model, fit.nuisance, fit.law_offsets)[None]
    angle = forward.predict([fit.model], nuisance)[0][:, 3 * records.ball_time.shape[1] :]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.gradient(angle, axis=1) / np.gradient(records.pendulum_time, axis=1)
    return SwingState(
        angle, np.nan_to_num(rate, posinf=0.0, neginf=0.0), body.inertia, body.mass, body.com,
        body.length, forward.baseline.gravity, records.order[:, None],
    )  # fmt: skip


def _force_along(
    forward: Forward, fit: Fit, effect: Effect
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Force (3, T, S), velocity (3, T, S) and time since touch of the ball's rows."""
    flight, ball = flight_state(forward, fit)
    force = effect.force(_values_of(fit, effect), flight)
    velocity = np.stack([np.broadcast_to(v, ball.shape) for v in (flight.vx, flight.vy, flight.vz)])
    return np.stack([np.broadcast_to(f, ball.shape) for f in force]), velocity, ball


def _later(forward: Forward, nuisance: FloatArray, step: float) -> FloatArray:
    shifted = nuisance.copy()
    if forward.mode == "impact":
        shifted[..., 0] -= step
    else:
        gravity = np.array([0.0, -forward.baseline.gravity, 0.0])
        shifted[..., :3] += step * nuisance[..., 3:6]
        shifted[..., 3:6] += step * gravity
    return shifted


def where_it_is_largest(forward: Forward, fit: Fit) -> Location:
    """Where a misfit sits that nothing explains: the channel and the time that hold most of it."""
    ball, swing = _since(forward, fit)
    s = ball.shape[1]
    best = (-1.0, 0, ball, fit.residual[:, :s])
    for channel in range(4):
        at = slice(channel * s, (channel + 1) * s) if channel < 3 else slice(3 * s, None)
        mine = fit.residual[:, at]
        size = float(np.sum(mine**2))
        if size > best[0]:
            best = (size, channel, swing if channel == 3 else ball, mine)
    _, channel, time, mine = best
    squares, order = mine**2, np.argsort(time, axis=None)
    share = np.cumsum(squares.reshape(-1)[order]) / max(float(squares.sum()), 1e-300)
    start, end = (float(time.reshape(-1)[order][np.searchsorted(share, q)]) for q in (0.05, 0.95))
    name = ("horizontal", "vertical", "out_of_plane", "angle")[channel]
    phase = "swing" if channel == 3 else "flight"
    words = name.replace("_", " ")
    return Location(
        phase, start, end, name,
        f"Most of the misfit is {words}, from {start:.3g} s to {end:.3g} s.",
    )  # fmt: skip


def _release(forward: Forward, fit: Fit) -> FloatArray:
    if forward.mode != "impact":
        return np.zeros((forward.records.trials, 1))
    gap = np.zeros((forward.records.trials, 1))
    for index, name in enumerate(forward.records.ball_names):
        table = forward.baseline.ball(name or None).table
        mine = forward.records.ball_index == index
        if table is not None:
            gap[mine, 0] = table(forward.nominal_speed()[mine])[1]
    return gap


def _flight_location(forward: Forward, fit: Fit, effect: Effect) -> Location:
    force, velocity, time = _force_along(forward, fit, effect)
    records = forward.records
    gap = _release(forward, fit)
    flying = records.ball_used.any(axis=-1) & (time >= gap)
    size = np.sqrt((force**2).sum(axis=0))
    peak = np.where(flying, size, 0.0).max(axis=1, keepdims=True)
    # Trials that never come near a local force don't say when it acts.
    reached = peak[:, 0] > 0.3 * peak.max()
    felt = flying & (size > (FELT_LOCALLY if _is_local(effect) else FELT) * peak)
    starts = np.where(felt, time, np.inf).min(axis=1)[reached]
    ends = np.where(felt, time, -np.inf).max(axis=1)[reached]
    first = np.where(flying, time, np.inf).min(axis=1)[reached]
    start = np.where(starts <= first + 1e-9, gap[reached, 0], starts)
    speed = np.sqrt((velocity**2).sum(axis=0))
    weight = np.where(flying, size, 0.0)
    total = max(float(weight.sum()), 1e-30)
    along = np.abs((force * velocity).sum(axis=0)) / np.maximum(speed, 1e-9)
    normal = np.abs(force[1] * velocity[0] - force[0] * velocity[1]) / np.maximum(speed, 1e-9)
    shares = {
        "along_velocity": float(np.where(flying, along, 0.0).sum()) / total,
        "normal_to_velocity": float(np.where(flying, normal, 0.0).sum()) / total,
        "horizontal": float(np.where(flying, np.abs(force[0]), 0.0).sum()) / total - 1e-3,
        "vertical": float(np.where(flying, np.abs(force[1]), 0.0).sum()) / total - 1e-3,
        "out_of_plane": float(np.where(flying, np.abs(force[2]), 0.0).sum()) / total - 1e-3,
    }
    channel = max(shares, key=lambda name: shares[name])
    if effect.form in shares:
        channel = effect.form
    t0, t1 = float(np.median(start)), float(np.median(ends))
    words = channel.replace("_", " ")
    since = "first touch" if forward.mode == "impact" else "first sample"
    return Location(
        "flight", t0, t1, channel,
        f"Simulation and recording disagree in flight, {words}, from {t0:.3f} s to {t1:.3f} s"
        f" after the {since}.",
    )  # fmt: skip


def _swing_location(forward: Forward, fit: Fit, effect: Effect) -> Location:
    _, time = _since(forward, fit)
    records = forward.records
    used = records.pendulum_used
    seen = time[used] if used.any() else np.zeros(1)
    start, end = float(seen.min()), float(seen.max())
    if (
        "torque" in effect.hooks
        and effect.id == EffectId.UNNAMED
        and forward.baseline.pendulum is not None
    ):
        body = forward.baseline.pendulum
        swing = SwingState(
            records.pendulum_angle, np.ones_like(time), body.inertia, body.mass, body.com,
            body.length, forward.baseline.gravity, records.order[:, None],
        )  # fmt: skip
        torque = np.broadcast_to(effect.torque(_values_of(fit, effect), swing), time.shape)
        size = np.where(used, np.abs(np.asarray(torque)), 0.0)
        felt = size > FELT * size.max()
        passing = felt.any(axis=1)
        if passing.any():
            start = float(np.median(np.where(felt, time, np.inf).min(axis=1)[passing]))
            end = float(np.median(np.where(felt, time, -np.inf).max(axis=1)[passing]))
    return Location(
        "swing", start, end, "angle",
        f"Simulation and recording disagree in the swing, from {start:.3f} s to {end:.3f} s"
        + (" after the first sample." if forward.mode == "swing"
           else " (negative: before the first touch)."),
    )  # fmt: skip


def _is_local(effect: Effect) -> bool:
    return effect.id == EffectId.UNNAMED and bool(LOCAL.intersection(p.name for p in effect.shapes))


def _unheld(forward: Forward, fit: Fit, effect: Effect) -> Fit:
    """The fit with the shape of an unnamed force let go.

    Shapes were held near where the search found them, which makes short gusts too long.
    """
    if not _is_local(effect):
        return fit
    free = fit_model(
        forward, fit.model, fit.free, (fit.nuisance, fit.law_offsets), rounds=8, shape_priors=False
    )
    return free if free.inside_bounds and free.chi2 <= fit.chi2 else fit


def locate(
    forward: Forward, base: Fit, best: Hypothesis | None, first: Effect | None = None
) -> Location | None:
    """Where the mismatch sits: by the strongest effect if one was named, else by the scan.

    Parameters
    ----------
    first : Effect, optional
        The strongest effect of the answer; its first member by default.

    Returns
    -------
    Location or None
        None where nothing is missing.
    """
    if best is None:
        found = scan_windows(forward, base)
        if not found.significant:
            return None
        phase = "swing" if found.channel == "angle" else "flight"
        channel = {"x": "horizontal", "y": "vertical", "z": "out_of_plane"}.get(
            found.channel, "angle"
        )
        return Location(
            phase, found.start, found.end, channel,
            f"Residuals of {found.channel} lean to one side from {found.start:.3f} s to"
            f" {found.end:.3f} s.",
        )  # fmt: skip
    effect = best.members[0].effect if first is None else first
    if effect.phase == "flight" and "force" in effect.hooks:
        return _flight_location(forward, _unheld(forward, best.fit, effect), effect)
    if effect.phase == "swing":
        return _swing_location(forward, best.fit, effect)
    if effect.phase == "contact":
        gap = float(np.median(_release(forward, best.fit)))
        across = effect.id == EffectId.UNNAMED
        phase = "across_trials" if across else "contact"
        words = "drifts from trial to trial" if across else "starts at the contact"
        return Location(
            phase, 0.0, gap, "along_velocity", f"The mismatch {words}: within {gap:.4f} s of touch."
        )
    ball, swing = _since(forward, best.fit)
    times = [t[u] for t, u in (
        (ball, forward.records.ball_used.any(axis=-1)), (swing, forward.records.pendulum_used)
    ) if u.any()]  # fmt: skip
    start, end = float(min(t.min() for t in times)), float(max(t.max() for t in times))
    values = _values_of(best.fit, effect)
    if "instant" in values:
        start = float(np.asarray(values["instant"]))
    return Location(
        "measurement", start, end, "horizontal",
        "The mismatch belongs to the instrument, not to the motion.",
    )  # fmt: skip


def _whiteness(forward: Forward, fit: Fit) -> float:
    records = forward.records
    s = records.ball_time.shape[1]
    pieces: list[tuple[FloatArray, FloatArray]] = []
    for trial in range(records.trials):
        for k in range(4):
            at = slice(k * s, (k + 1) * s) if k < 3 else slice(3 * s, None)
            mask = records.used[trial, at]
            time = records.ball_time[trial] if k < 3 else records.pendulum_time[trial]
            pieces.append((time[mask], fit.residual[trial, at][mask]))
    return whiteness(pieces)


def remainder_of(prepared: Prepared, best: Hypothesis | None) -> Remainder:
    """What is left after the best model, and whether it can be distinguished from noise."""
    forward = prepared.forward
    fit = prepared.fit if best is None else best.fit
    probability = _whiteness(forward, fit)
    before = _whiteness(forward, prepared.fit)
    reduced = fit.chi2 / fit.expected
    correlated = bool((prepared.noise.inflation > 1.0).any())
    scanned = scan_windows(forward, fit)
    spread = 4.0 * np.sqrt(2.0 / max(fit.count, 1)) * (2.0 if correlated else 1.0)
    white = bool(reduced < 1.0 + spread) and not scanned.significant
    if not correlated:
        white = white and probability > 1e-3
    subject = "The baseline's residuals" if best is None else "What remains after the best model"
    verb = "cannot be distinguished from noise" if white else "still holds structure"
    text = f"{subject} {verb} (chi2 per degree of freedom {reduced:.2f})."
    if correlated or probability == before == 1.0:
        # Noise that remembers is never white: its p-value would accuse the model of the noise.
        # Records too short for it have none.
        return Remainder(white, text)
    if best is None:
        text += f" Whiteness of the residuals: p = {probability:.1g}."
    else:
        text += f" Whiteness of the residuals: p = {before:.1g} before, {probability:.1g} after."
    return Remainder(white, text)


def noise_notes(campaign: CampaignRecords, prepared: Prepared) -> tuple[str, ...]:
    """What the data say about their noise, where it is not as claimed."""
    notes = []
    noise, base = prepared.noise, prepared.forward.baseline
    used = prepared.forward.records.ball_used.any(axis=(0, 1))
    position = float(np.sqrt(np.mean(noise.sigma[:, :3][:, used] ** 2))) if used.any() else None
    for what, claim, found, unit in (
        ("positions", base.position_noise, position, "m"),
        ("angles", base.angle_noise, float(np.mean(noise.sigma[:, 3])), "rad"),
    ):
        if claim is not None and found is not None and not 0.85 < found / claim < 1.18:
            notes.append(
                f"the noise of the {what} is {found:.2g} {unit}, not {claim:.2g} as claimed;"
                " the estimate was used"
            )
    if (noise.inflation > 1.5).any():
        worst = float(noise.inflation.max())
        notes.append(
            f"neighbouring samples share errors: slow quantities are {np.sqrt(worst):.1f} times"
            " less certain than white noise would leave them"
        )
    slow = prepared.forward.records.slow
    if np.any(slow > 0.0):
        largest = float(np.sqrt(np.square(noise.effective[:, :3]) @ slow.sum(axis=1)).max())
        rows = float(prepared.forward.records.ball_used.any(axis=-1).sum(axis=1).mean())
        notes.append(
            f"positions wander by {largest / np.sqrt(rows):.2g} m over each record: slow quantities"
            " are so much less certain"
        )
    if noise.jitter > 0.0:
        notes.append(
            f"the times of the samples scatter by {noise.jitter:.2g} s about those that are written"
        )
    stated = [t.position_std for t in campaign.trials if t.position_std is not None]
    if stated and position is not None:
        values = np.concatenate([one.reshape(-1) for one in stated])
        values = values[np.isfinite(values) & (values > 0.0)]
        # Squares of the smallest numbers are zero.
        largest = float(values.max(initial=0.0))
        column = largest * float(np.sqrt(np.mean((values / largest) ** 2))) if largest else position
        if not 0.85 < position / column < 1.18:
            notes.append(
                f"the file states {column:.2g} m for its positions' uncertainty, they scatter by"
                f" {position:.2g} m; the scatter was used"
            )
    count = int(noise.outliers.sum())
    if count:
        notes.append(f"{count} samples are outliers and were left out")
    return tuple(notes)
