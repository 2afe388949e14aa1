"""What was renamed says its successor when it is asked for."""

import pytest

import graspless_pin
from graspless_pin import viewer


@pytest.mark.parametrize(
    ("module", "name", "successor"),
    [
        (graspless_pin, "picture", "graspless_pin.visualization"),
        (viewer, "Evaluation", "SettingsAnswer"),
        (viewer, "evaluate", "answer_settings"),
    ],
)
def test_a_name_that_was_given_up_tells_its_successor(module, name, successor):
    with pytest.raises(AttributeError, match=f"{name} was renamed to {successor}$"):
        getattr(module, name)


@pytest.mark.parametrize("module", [graspless_pin, viewer])
def test_other_names_are_unknown(module):
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        module.__getattr__("nothing")
