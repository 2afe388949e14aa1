"""Two one-joint fingers pinch a block that stands on one point of the floor."""

import numpy as np

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque

jacobian = np.zeros((9, 2))  # (3M, L), J^T f = tau
jacobian[1, 0] = -0.1  # finger 1: tau_1 = -0.1 m * f_y at contact 0
jacobian[4, 1] = 0.1  # finger 2: tau_2 = +0.1 m * f_y at contact 1

problem = QuasistaticProblem(
    positions=[[0, -0.05, 0], [0, 0.05, 0], [0, 0, -0.05]],  # m, about the centre of mass
    normals=[[0, 1, 0], [0, -1, 0], [0, 0, 1]],  # unit, into the object
    external_wrench=[0, 0, -4.9, 0, 0, 0],  # [force; moment], N and N m
    jacobian=jacobian,
    friction=0.5,
    torque_limits=(-2.0, 2.0),  # N m
    joint_names=["left", "right"],
)

best = maximize_margin(problem)  # Algorithm 1
print(best)

least = minimize_torque(problem, margin=0.2)  # Algorithm 2, margin in N
print()
print(least)
