"""Random examples that repeat, and one cache of measured clips for each test run.

An exploring run (``HYPOTHESIS_PROFILE=explore pytest -m 'slow or not slow'``) draws new examples;
those that fail become an ``@example`` of their test, so that the default run repeats them.
"""

import os
import tempfile

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, database=None, deadline=None)
settings.register_profile("explore", max_examples=500, deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

# A clip measured by one test is loaded by the others of the same run, in all workers. The folder is
# new in every run, so that no result of earlier code is used.
if "PYTEST_XDIST_WORKER" not in os.environ:
    _MEASURED = tempfile.TemporaryDirectory(
        prefix="impact-vision-tests-", ignore_cleanup_errors=True
    )
    os.environ["IMPACT_VISION_CACHE"] = _MEASURED.name
else:
    os.environ.setdefault("IMPACT_VISION_CACHE", "off")
