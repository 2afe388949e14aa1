"""A judge that is lost at one seed and never ends at another; its processes load nothing else."""

import os
import time

from tests.oracles.outcome import Outcome
from tests.oracles.scales import Judged


def ends_or_sleeps(seed: int) -> Judged:
    """Agree but at seeds 2 and 5."""
    if seed == 2:
        os._exit(7)
    if seed == 5:
        time.sleep(600.0)
    return Judged(seed, Outcome.AGREE, "", 1e-9, found=True)
