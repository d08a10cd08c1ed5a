"""Named ways to break a law or a decision, each with the tests that should notice."""

from dataclasses import dataclass

__all__ = ["MUTANTS", "Mutant"]


@dataclass(frozen=True)
class Mutant:
    """One line broken.

    Attributes
    ----------
    name : str
        What is wrong with it, in words.
    path : str
        The module.
    before, after : str
        The text that stands there once, and what takes its place.
    tests : str
        Test file that should fail.
    """

    name: str
    path: str
    before: str
    after: str
    tests: str


_PHYSICS = "tests/physics/"

MUTANTS = (
    Mutant("the pendulum gains what it gives", "physics/contact.py",
           "speed - impulse / effective_mass", "speed + impulse / effective_mass",
           _PHYSICS + "contact/test_impact.py"),
    Mutant("the COR is one too large", "physics/contact.py",
           "(effective_mass * before) - 1.0", "(effective_mass * before)",
           _PHYSICS + "contact/test_impact.py"),
    Mutant("half the energy of the swing is lost", "physics/swing.py",
           "pendulum.length * (scale * drop) ** 0.5", "pendulum.length * (scale * drop / 2) ** 0.5",
           _PHYSICS + "test_swing.py"),
    Mutant("drag is twice as strong in the closed form", "physics/flight.py",
           "0.5 * air.density * ball.area", "1.0 * air.density * ball.area",
           _PHYSICS + "flight/test_flight.py"),
    Mutant("the ball falls half the height", "physics/flight.py",
           "rise * rise + 2.0 * gravity * height", "rise * rise + gravity * height",
           _PHYSICS + "flight/test_flight.py"),
    Mutant("forces of the catalogue are twice as strong", "physics/effects/base.py",
           "return 0.5 * self.air_density * self.area", "return self.air_density * self.area",
           _PHYSICS + "effects/test_catalogue.py"),
    Mutant("the COR law is shifted the wrong way", "physics/restitution.py",
           "np.exp(-self.rate * speed - self.shift)", "np.exp(-self.rate * speed + self.shift)",
           _PHYSICS + "restitution/test_restitution.py"),
    Mutant("a COR above one is let in", "physics/restitution.py",
           "(values > 0.0) & (values <= 1.0)", "(values > 0.0)",
           _PHYSICS + "restitution/test_restitution.py"),
    Mutant("Eq. 17 forgets that the pendulum slows", "physics/forward.py",
           "mean_speed = 0.5 * (inputs.impact_speed + after)", "mean_speed = inputs.impact_speed",
           _PHYSICS + "restitution/test_inversion.py"),
    Mutant("Eq. 22 counts the slowing twice", "physics/forward.py",
           "kept = 1.0 - 0.5 * inputs.ball_mass", "kept = 1.0 - inputs.ball_mass",
           _PHYSICS + "restitution/test_inversion.py"),
    Mutant("uncertainties add up instead of their squares", "metrology/quantity.py",
           "math.sqrt(sum(line.std**2 for line in budget))", "sum(line.std for line in budget)",
           "tests/metrology/test_quantity.py"),
    Mutant("digits are counted before rounding", "metrology/quantity.py",
           'math.log10(float(f"{std:.1e}"))', "math.log10(std)",
           "tests/metrology/test_formatting.py"),
    Mutant("a number too large is let in", "metrology/measurands.py",
           "self.lowest <= value <= self.highest", "self.lowest <= value",
           "tests/metrology/test_measurands.py"),
    Mutant("an assumed rate passes as known", "vision/clip/footage.py",
           "        math.inf,\n        RateSource.ASSUMED",
           "        0.2,\n        RateSource.ASSUMED",
           "tests/vision/clip/test_capture_rate.py"),
    Mutant("the setup's rate goes before the option's", "vision/clip/footage.py",
           "    if option is not None:", "    if option is not None and setup is None:",
           "tests/vision/clip/test_capture_rate.py"),
    Mutant("the two fields of a picture are swapped", "vision/clip/clip.py",
           "first = 1 if bottom else 0", "first = 0 if bottom else 1",
           "tests/vision/clip/test_fields.py"),
    Mutant("times stay on the container's clock", "vision/clip/clip.py",
           "return times * (self.info.container_fps / capture_fps)", "return times",
           "tests/vision/clip/test_clip.py"),
    Mutant("gravity off by half contradicts nothing", "pipelines/measure/gravity.py",
           "off = abs(value / gravity - 1.0)", "off = 0.1 * abs(value / gravity - 1.0)",
           "tests/pipelines/measure/test_gravity.py"),
    Mutant("a name may be a formula", "pipelines/measure/files.py",
           "isinstance(cell, str) and cell", "isinstance(cell, bytes) and cell",
           "tests/pipelines/measure/test_output.py"),
    Mutant("brackets are taken for markup", "pipelines/terminal.py",
           "markup=False", "markup=True", "tests/pipelines/test_terminal.py"),
    Mutant("workers go on after the end", "pipelines/measure/commands.py",
           "    finally:\n        for worker in busy:\n            worker.end()",
           "    finally:\n        for worker in busy:\n            worker.pipe.fileno()",
           "tests/pipelines/batch/test_workers.py"),
    Mutant("other options don't measure anew", "pipelines/measure/commands.py",
           "self._made.get(str(clip)) == digest", "str(clip) in self._made",
           "tests/pipelines/batch/test_folder.py"),
    Mutant("a flight to the left stays backwards", "pipelines/explain/clips.py",
           "forward = 1.0 if place[end - 1, 0] >= place[first, 0] else -1.0", "forward = 1.0",
           "tests/pipelines/explain/test_tracks.py"),
    Mutant("the contact counts as flight", "pipelines/explain/clips.py",
           "(away > (0.0 if np.isnan(reach) else reach))", "(away >= 0.0)",
           "tests/pipelines/explain/test_tracks.py"),
    Mutant("the bounce counts as flight", "pipelines/explain/clips.py",
           "end = _bounce(time, place[:, 1])", "end = len(time)",
           "tests/pipelines/explain/test_tracks.py"),
    Mutant("a clock that was set back is sorted", "pipelines/explain/campaign.py",
           "later[0] < earlier[1]", "later[0] < earlier[0]",
           "tests/pipelines/explain/test_files.py"),
    Mutant("a foreign page may act", "pipelines/web.py",
           "if not hmac.compare_digest(given[0].encode(), self._token.encode()):",
           "if not given:", "tests/pipelines/web/test_guard.py"),
    Mutant("a law's covariance need not be one", "pipelines/setup/cor_file.py",
           "np.abs(covariance - covariance.T).max() > 1e-9 * scale or lowest < -1e-9 * scale",
           "np.abs(covariance - covariance.T).max() > 1e9 * scale",
           "tests/pipelines/setup/test_cor_file.py"),
    Mutant("relative uncertainties are absolute", "pipelines/setup/file.py",
           "return self.std / abs(self.value) if self.value else 0.0", "return self.std",
           "tests/pipelines/setup/test_rig.py"),
    Mutant("a budget's shares are not of the variance", "pipelines/api/quantities.py",
           "line.std**2 / total if total else 0.0", "line.std / total if total else 0.0",
           "tests/impact_vision/test_quantities.py"),
    Mutant("taped scenes ask for a fall", "calib/solve.py",
           "if see_fall is None or evidence.taped:", "if see_fall is None:",
           "tests/calib/test_solve.py"),
    Mutant("a fall that contradicts takes part", "calib/solve.py",
           ">= DISAGREE_AT * math.hypot(", ">= 1e9 * math.hypot(", "tests/calib/test_solve.py"),
    Mutant("the pitch is ten times as sure", "calib/solve.py",
           "_one(c.parameters.log_pitch / pitch_std)",
           "_one(10 * c.parameters.log_pitch / pitch_std)",
           "tests/calib/test_solve.py"),
    Mutant("a sphere's rim lies behind its centre", "calib/camera.py",
           "centre - towards * (radius**2 / distance)", "centre + towards * (radius**2 / distance)",
           "tests/calib/camera/test_camera.py"),
    Mutant("a rate goes with the square of a fall", "vision/clip/footage.py",
           "fps = float(np.sqrt(acceleration / per_frame2))",
           "fps = float(acceleration / per_frame2)", "tests/calib/test_time_base.py"),
    Mutant("the outline may run ahead at will", "pipelines/measure/impact.py",
           " + OUTLINE_AHEAD_STD**-2)", ")", "tests/pipelines/measure/test_contact_fit.py"),
    Mutant("the pendulum's length is exact", "pipelines/measure/budget.py",
           "length=body.length * (1 + rig.length.relative_std)", "length=body.length",
           "tests/pipelines/measure/test_budget.py"),
    Mutant("laws of balls have no prior", "mismatch/fitting/fit.py",
           "1.0 / np.maximum(laws, 1e-12) ** 2", "1.0 / np.maximum(laws, 1e12) ** 2",
           "tests/mismatch/fitting/test_normal_equations.py"),
    Mutant("swapped columns are not told", "mismatch/sanity.py",
           "SWAP_GAIN = 0.1", "SWAP_GAIN = 1e-9", "tests/mismatch/test_bad_input.py"),
    Mutant("a body turns the other way about its pivot", "vision/pendulum/arc.py",
           "self.pivot_px + self.turning(angle) @ (self.centre_px",
           "self.pivot_px + self.turning(-angle) @ (self.centre_px",
           "tests/vision/pendulum/test_makes.py"),
    Mutant("outlines of another size are averaged", "vision/ball/refine.py",
           "near = np.abs(rough.radius / radius - 1.0) < 0.1",
           "near = np.abs(rough.radius / radius - 1.0) > 0.1", "tests/vision/ball/test_refine.py"),
    Mutant("the setup's uncertainties are forgotten", "pipelines/model.py",
           "known.std_from is Origin.SETUP", "known.std_from is Origin.PRESET",
           "tests/pipelines/setup/test_reach.py"),
)  # fmt: skip
