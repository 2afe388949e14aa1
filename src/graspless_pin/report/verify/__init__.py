"""Check a solution from its JSON document with numpy alone.

The checker uses nothing of the package's own algebra and trusts no figure of the answer: it works
out each one again from the data of the problem, and verifies each proof.
"""

from graspless_pin.report.verify.checking import verify_document
from graspless_pin.report.verify.outcome import Check, Verification

__all__ = ["Check", "Verification", "verify_document"]
