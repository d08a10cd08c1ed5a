"""A worker that speaks the workers' protocol and draws its numbers from a known law.

The clip's name sets its behaviour: ``crash``, ``hang``, ``eat`` and ``refuse`` fail.
"""

import json
import math
import os
import sys
import time
import zlib


def reply(path: str) -> dict[str, object]:
    """Numbers of the law e = 0.1073 exp(-0.2685 v) + 0.6746, seeded by the clip's name."""
    name = os.path.basename(path)
    if "crash" in name:
        os.kill(os.getpid(), 9)
    if "hang" in name:
        time.sleep(60)
    if "eat" in name:
        _held = bytearray(600 * 2**20)
        time.sleep(60)
    if "refuse" in name:
        return {"error": "no ball is seen", "document": None}
    seed = zlib.crc32(name.encode())
    speed = 1.0 + 3.0 * (seed % 1000) / 1000
    cor = 0.1073 * math.exp(-0.2685 * speed) + 0.6746 + 0.004 * math.sin(seed)
    time.sleep(float(os.environ.get("STAND_IN_SECONDS", "0")))
    return {
        "document": {
            "quantities": {
                "pendulum_speed_before": {"value": speed, "std": 0.01, "unit": "m/s"},
                "cor": {"value": cor, "std": 0.005, "unit": "1"},
                "landing_distance": {"value": None, "unit": "m", "reason": "out of view"},
            },
            "budget": {"cor": [{"source": "mass of the ball", "std": 0.003, "shared": True}]},
            "warnings": [],
            "motion": {"kind": "strike", "probability": 0.99},
        }
    }


if __name__ == "__main__":
    for line in sys.stdin:
        began = time.monotonic()
        answer = reply(json.loads(line)["path"])
        answer["seconds"] = time.monotonic() - began
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
