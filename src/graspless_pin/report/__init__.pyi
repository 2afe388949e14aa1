from .document import solution_document, write_document
from .document_files import write_path_documents
from .reading import read_document, read_solution
from .text import scene_solution_text

__all__ = [
    "read_document",
    "read_solution",
    "scene_solution_text",
    "solution_document",
    "write_document",
    "write_path_documents",
]
