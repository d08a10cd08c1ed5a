"""Many clips at once: processes that outlive crashes, and a folder of results that grows."""
