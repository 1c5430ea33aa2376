"""Settings for all tests."""

from hypothesis import settings

# Times on shared machines mean nothing: no deadlines. Few examples, the same ones each time: the suite stays fast.
settings.register_profile("suite", deadline=None, max_examples=50, derandomize=True)
settings.load_profile("suite")
