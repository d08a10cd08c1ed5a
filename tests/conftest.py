"""One set of random examples for everybody: the default run repeats, a slow run explores.

What an exploring run finds (``HYPOTHESIS_PROFILE=explore pytest -m 'slow or not slow'``) becomes an
``@example`` beside the test, so that the default run keeps it.
"""

import os

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, database=None, deadline=None)
settings.register_profile("explore", max_examples=500, deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

# what one run measured must not answer the next; tests of the cache name a folder of their own
os.environ["IMPACT_VISION_CACHE"] = "off"
