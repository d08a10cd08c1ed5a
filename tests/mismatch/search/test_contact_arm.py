"""A contact arm 2.5 mm shorter in an independent simulator."""

import json

from bench.concealed.foreign import convert
from measuring.setup.file import load_setup
from mismatch.candidates import candidates_for
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from physics.effects import CATALOGUE
from pipelines.explain.campaign import baseline_from_setup, load_campaign
from tests.shared_data import shared_folder


def test_a_shorter_arm_is_distinguished_from_a_tilted_camera(tmp_path):
    answers = shared_folder("concealed_foreign").glob("*/answer.json")
    keys = {one.parent: json.loads(one.read_text()) for one in answers}
    (source, *_) = [
        folder for folder, key in sorted(keys.items())
        if [e["name"] for e in key["effects"]] == ["contact_arm"] and key["level"] == "strong"
    ]  # fmt: skip
    convert(source, tmp_path)
    setup = load_setup(tmp_path / "setup.toml")
    campaign = load_campaign(tmp_path / "ball.csv", tmp_path / "pendulum.csv", setup)
    known = prepare(campaign, baseline_from_setup(setup, campaign))
    effects = [*CATALOGUE["effective_mass"], *CATALOGUE["camera_roll"]]
    pool = candidates_for(known.forward, known.model, effects, unnamed=False)
    scored = scan(known.forward, known.fit, pool)
    gains = {(c.id, c.effect.form): scored.gain(k)[0] for k, c in enumerate(pool)}
    arm = gains["effective_mass", "geometry"]
    assert arm > 0.9 * keys[source]["delta_chi2"]
    assert arm > 20.0 + max(g for (one, form), g in gains.items()
                            if one == "camera_roll" and form != "perspective")  # fmt: skip
