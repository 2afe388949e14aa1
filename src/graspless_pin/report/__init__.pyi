from .document import solution_document as solution_document
from .document import write_document as write_document
from .document import write_path_documents as write_path_documents
from .reading import read_document as read_document
from .reading import read_solution as read_solution
from .text import scene_solution_text as scene_solution_text
