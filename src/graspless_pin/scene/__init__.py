"""YAML scenes and the way from bodies to a problem."""

import lazy_loader

# Names are imported at first use; the .pyi file beside this one lists them.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
