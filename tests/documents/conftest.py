"""What the tests of the documents share: the hooks that draw the pictures can be imported."""

import sys

from page_blocks import ROOT

sys.path.append(str(ROOT / "mkdocs_hooks"))
