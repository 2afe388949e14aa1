"""What comes of judging an answer; nothing else is loaded with it."""

from enum import StrEnum


class Outcome(StrEnum):
    """How an answer and the exact optimum compare."""

    AGREE = "agree"
    REFUSED = "refused"
    TOO_LARGE = "load too large"
    UNVERIFIED = "unverified"
    THRESHOLD = "hangs on the threshold"
    TOLERANCE = "hangs on the tolerance"
    WRONG = "WRONG"
