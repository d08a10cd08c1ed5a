"""An angle read off by a function of itself is an error of reading, not a torque."""

import numpy as np

from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import as_fitted, fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.records import Baseline, CampaignRecords, Trial
from mismatch.search.unnamed import ReadingCurve
from physics.bodies import Pendulum
from physics.effects import CATALOGUE
from tests.mismatch.fitting.rubbing import swung

LENGTH, MASS, NOISE = 0.45, 0.3, 1.0e-3
BODY = Pendulum(length=LENGTH, inertia=MASS * LENGTH**2, mass=MASS, com=LENGTH)


def read_off(angle):
    """10 mrad too large in the middle, 7 mrad too small at the ends, either way it moves."""
    return angle + 0.0015 + 0.0085 * np.cos(np.pi * angle / 0.9)


def test_a_protractor_that_reads_off_beats_every_torque_beside_friction():
    rng, time, trials = np.random.default_rng(8), np.arange(0.0, 7.0, 1.0 / 50.0), []
    for number, start in enumerate((0.85, -0.7, 0.9)):
        truth = swung(start, time + 0.1, 9.80665 / LENGTH, lambda _: 0.15)
        seen = read_off(truth) + NOISE * rng.standard_normal(time.size)
        trials.append(Trial(str(number), np.zeros(0), np.zeros((0, 3)), time, seen))
    known = prepare(CampaignRecords(tuple(trials)), Baseline({}, pendulum=BODY))
    forward, base = known.forward, known.fit
    dry = candidates_for(forward, known.model, [CATALOGUE["bearing_friction"][0]], unnamed=False)[0]
    rubbed = fit_hypothesis(forward, base, [dry], [np.array([0.01])])
    assert rubbed.reduced_chi2 > 10.0
    catalogue = [form for forms in CATALOGUE.values() for form in forms]
    scored = scan(forward, rubbed.fit, candidates_for(forward, rubbed.fit.model, catalogue))
    scored = scored.with_likely_widths()
    fits = {}
    for place in sorted(range(len(scored.candidates)), key=lambda k: -scored.gain(k)[0])[:5]:
        further = scored.candidates[place]
        members, strengths = as_fitted(rubbed.members, rubbed.fit)
        values = scored.gain(place)[1]
        both = fit_hypothesis(
            forward, base, [*members, further], [*strengths, values], start=rubbed.fit
        )
        fits[type(further.effect)] = both
    best = max(fits.values(), key=lambda h: h.penalised_gain)
    assert fits[ReadingCurve] is best
    assert best.allowed
    assert best.reduced_chi2 < 1.2
    (curve,) = (m.effect for m in best.members if m.id == "unnamed")
    assert curve.phase == "measurement"
    values = next(v for e, v in best.fit.model.entries if e is curve)
    angle = np.linspace(-0.8, 0.8, 60)
    wanted, found = read_off(angle) - angle, curve.size(values, angle)
    # A constant is the zero of the angle, a slope its scale: neither is an error of this kind.
    line = np.vander(angle, 2)
    rest = wanted - found - line @ np.linalg.lstsq(line, wanted - found, rcond=None)[0]
    assert np.std(rest) < 0.15 * np.std(wanted)
