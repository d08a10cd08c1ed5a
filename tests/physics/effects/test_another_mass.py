"""Contact with another lever arm or mass compared with an integrated spring."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from physics.effects import CATALOGUE, Contact, Form, Outcome

LENGTH, INERTIA, MASS, PACE = 0.55, 1.6, 0.35, 3.0
STIFFNESS = {1.0: 2e4, 1.5: 2e5}


def struck(power, length=LENGTH, inertia=INERTIA):
    """A level blow without losses: a bar on an axle and a ball, a spring of the way to `power`."""

    def motion(_, state):
        angle, rate, place, speed = state
        push = STIFFNESS[power] * max(length * angle - place, 0.0) ** power
        return rate, -push * length / inertia, speed, push / MASS

    def apart(t, state):
        return length * state[0] - state[2] if t > 1e-3 else 1.0

    apart.terminal = True
    rate = PACE / LENGTH
    start = (0.0, rate, 0.0, 0.0)
    end = solve_ivp(motion, (0.0, 0.1), start, events=apart, rtol=1e-9, atol=1e-12, max_step=1e-4)
    return end.t[-1], end.y[:, -1]


@pytest.mark.parametrize("error", [-0.06, 0.06])
@pytest.mark.parametrize("form", [Form.ARM, Form.MASS])
def test_a_contact_time_is_between_those_of_a_linear_and_a_hertzian_spring(form, error):
    effect = next(one for one in CATALOGUE["effective_mass"] if one.form == form)
    (name,) = (p.name for p in effect.parameters)
    contact = Contact(PACE / LENGTH, 0.0, LENGTH, INERTIA, MASS, 0.2, 1.0, 0.0)
    found, true = [], []
    for power in STIFFNESS:
        time, (angle, rate, place, speed) = struck(power)
        before = Outcome(time, rate * LENGTH, angle, place, 0.0, 0.0, speed, 0.0, 0.0)
        after = effect.contact({name: error}, contact, before)
        length = LENGTH * (1.0 + error) if form == Form.ARM else LENGTH
        inertia = INERTIA * (1.0 + error) if form == Form.MASS else INERTIA
        other, (turned, _, moved, _) = struck(power, length, inertia)
        found.append((after.contact_time / time, after.x / place, after.pendulum_angle / angle))
        true.append((other / time, moved / place, turned / angle))
    linear, hertz = true
    assert min(linear[0], hertz[0]) < found[0][0] < max(linear[0], hertz[0])
    for k in (1, 2):
        slack = 0.2 * abs(np.array(true)[:, k] - 1.0).max()
        low, high = sorted((linear[k], hertz[k]))
        assert low - slack < found[0][k] < high + slack
