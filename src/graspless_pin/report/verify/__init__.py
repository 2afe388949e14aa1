"""Check a solution from its JSON document with numpy alone.

Nothing of the package's own algebra is used, and nothing that the document states is trusted: each
figure is worked out again from the data of the problem, and each proof is gone through.
"""

from graspless_pin.report.verify.checking import verify_document
from graspless_pin.report.verify.outcome import Check, Verification

__all__ = ["Check", "Verification", "verify_document"]
