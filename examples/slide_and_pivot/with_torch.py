"""Slide and pivot with PyTorch: gradient ascent on a soft minimum of the margins along the way.

Needs the extra ``torch``. See ``task.py``. Inverse kinematics keep all gaps closed.
"""

# pyright: reportMissingImports=false

import numpy as np
import torch
from task import GOAL, LOWER, PINS, START, UNITS, UPPER, Task

from graspless_pin import Evaluator
from graspless_pin.interfaces.torch import optimum

STAGES = 5  # equal steps of the slide, and as many of the pivot
STEPS = 30  # of the ascent
RATE = 0.05  # UNITS a step, of Adam
SOFTNESS = 0.01  # N, of the minimum
SMOOTHNESS = 0.01  # N per square of a step in UNITS


class Joints(torch.autograd.Function):
    """The task's inverse kinematics: joints of (K, 3) states, with their derivatives."""

    @staticmethod
    def forward(ctx, states, task):
        q = [task.joints(state) for state in states.numpy()]
        rates = [task.joint_rates(state) for state in states.numpy()]
        ctx.save_for_backward(torch.tensor(np.array(rates)))
        return torch.tensor(np.array(q))

    @staticmethod
    def backward(ctx, *by_joints):
        return torch.einsum("kj,kjs->ks", *by_joints, *ctx.saved_tensors), None


def plan(task, stages=STAGES, steps=STEPS):
    """(K, 3) states from START to GOAL with the largest smallest margin."""
    evaluator = Evaluator(task.scene, algorithm="margin", pins=PINS)
    way = np.linspace(0.0, 2.0, 2 * stages + 1)
    # Where the slide ends, both motions count.
    along = np.sort(np.append(np.arange(len(way)), stages))
    twists = [task.box_rate(0.0)] * (stages + 1) + [task.box_rate(one) for one in way[stages:]]
    poses = torch.tensor(np.array([task.box(one).np for one in way]))[along]
    ends = torch.tensor(np.array([START, GOAL]) / UNITS)[:, 1:]
    low, high = (torch.tensor(bound[1:] / UNITS[1:]) for bound in (LOWER, UPPER))
    shares = torch.linspace(0.0, 1.0, len(way), dtype=ends.dtype)[1:-1, None]
    palms = torch.lerp(ends[0], ends[1], shares).requires_grad_()  # lift and pitch, UNITS
    ascent = torch.optim.Adam([palms], lr=RATE, maximize=True)
    for _ in range(steps):
        ascent.zero_grad()
        path = torch.vstack([ends[:1], palms, ends[1:]])
        states = torch.column_stack([torch.tensor(way), path]) * torch.tensor(UNITS)
        margins = optimum(evaluator, Joints.apply(states, task)[along], poses, twist=twists).value
        smallest = -SOFTNESS * torch.logsumexp(-margins / SOFTNESS, 0)
        (smallest - SMOOTHNESS * path.diff(dim=0).square().sum()).backward()
        ascent.step()
        with torch.no_grad():
            palms.clamp_(low, high)
    path = torch.vstack([ends[:1], palms.detach(), ends[1:]]).numpy()
    return np.column_stack([way, path]) * UNITS


def main():
    task = Task()
    states = plan(task)
    print(f"{len(states)} states; {task.smallest_margin(task.waypoints(states)):.3f} N at least")


if __name__ == "__main__":
    main()
