"""Solutions for people and for other programs: tables and JSON."""

from graspless_pin.report.document import solution_document, write_document
from graspless_pin.report.document_files import write_path_documents
from graspless_pin.report.reading import read_document, read_solution
from graspless_pin.report.text import scene_solution_text

__all__ = [
    "read_document",
    "read_solution",
    "scene_solution_text",
    "solution_document",
    "write_document",
    "write_path_documents",
]
