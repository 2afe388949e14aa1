"""YAML scenes and the way from bodies to a problem."""

import lazy_loader

# Each name is loaded at first use; which they are stands in the .pyi beside.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
