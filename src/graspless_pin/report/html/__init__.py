"""A solution as one self-contained HTML page that fetches nothing.

Needs the extra ``report``.
"""

from graspless_pin.report.html.case import (
    Case,
    case_of_document,
    case_of_scene,
    case_with_tolerances,
)
from graspless_pin.report.html.page import report_html

__all__ = ["Case", "case_of_document", "case_of_scene", "case_with_tolerances", "report_html"]
