"""What is said of the verdict in a document, and ways to tamper with it."""

import json

import numpy as np

from graspless_pin.report.verify import verify_document


def rest_lines(made):
    """What is said of the verdict: the checks after those of the solution."""
    lines = verify_document(made).checks
    return lines[[line.name for line in lines].index("inertias") :]


def is_refused(made):
    """Whether something is said not to be so, or the document is none."""
    try:
        return any(line.passed is False for line in rest_lines(made))
    except ValueError:
        return True


def leaves(nodes):
    """Index of each leaf, and of its parent."""
    waiting, found = [], []
    for index, node in enumerate(nodes):
        while waiting and waiting[-1][1] == 0:
            waiting.pop()
        parent = None
        if waiting:
            parent = waiting[-1][0]
            waiting[-1][1] -= 1
        if not node["children"]:
            found.append((index, parent))
        waiting.append([index, node["children"]])
    return found


def zeroed(multipliers):
    return json.loads(json.dumps(multipliers), parse_float=lambda _: 0.0)


def times(factor):
    return lambda value: (factor * np.array(value)).tolist()
