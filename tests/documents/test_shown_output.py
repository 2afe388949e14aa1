"""The comparison of shown and printed output neither overlooks nor invents a difference."""

import pytest
from shown_output import difference

PRINTED = """\
margin e = 0.743701 N, 7 contacts

joint        torque
---------  --------
joint_0.0   -0.0048
joint_1.0   +0.1489
certificate: primal residual 3.2e-10
"""


@pytest.mark.parametrize(
    "shown",
    [
        PRINTED,
        PRINTED.replace("0.743701", "0.743702"),
        PRINTED.replace("3.2e-10", "8.9e-16"),
        PRINTED.replace("joint_0.0   -0.0048\njoint_1.0   +0.1489\n", "...\n"),
        PRINTED.replace("primal residual 3.2e-10", "..."),
        "margin e = 0.743701 N, 7 contacts\n...\n",
        "...\njoint_1.0 +0.1489\n...\n",
    ],
)
def test_the_same_output(shown):
    assert difference(shown, PRINTED) == ""


@pytest.mark.parametrize(
    "shown",
    [
        PRINTED.replace("0.743701", "0.743704"),
        PRINTED.replace("7 contacts", "8 contacts"),
        PRINTED.replace("joint_0.0", "joint_0.1"),
        PRINTED.replace("+0.1489", "-0.1489"),
        PRINTED.replace("3.2e-10", "3.2e-03"),
        PRINTED.replace("certificate", "proof"),
        PRINTED + "one more line\n",
        PRINTED.replace("joint_1.0   +0.1489\n", ""),
        "margin e = 0.743701 N, 7 contacts\n",
        "...\njoint_2.0 +0.1489\n...\n",
    ],
)
def test_another_output(shown):
    assert difference(shown, PRINTED)


def test_signs_of_a_mode_may_differ_at_the_end_of_a_line():
    assert difference("0 tip 0.5 sticking -+", "0 tip 0.5 sticking ++") == ""
    assert difference("0 tip 0.5 sticking -+", "0 tip 0.5 sliding ..")
    said = "holds (15 LPs); 30 sets of outcomes examined; try 300 (about 5 s)"
    other = "holds (17 LPs); 28 sets of outcomes examined; try 300 (about 2 min)"
    assert difference(said, other) == ""
    assert difference(said, other.replace("300", "200"))
