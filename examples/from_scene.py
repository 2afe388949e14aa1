"""A scene file: the Allegro hand keeps a box from sliding down a slope."""

from pathlib import Path

from graspless_pin import load_scene

scene = load_scene(Path(__file__).parent / "allegro_box_on_slope.yaml")

best = scene.solve("margin")  # Algorithm 1
print(f"largest margin {best.margin:.3f} N with at most {best.max_torque:.3f} N m")

least = scene.solve("torque", margin=0.1)  # Algorithm 2, margin in N
for name, torque in least.torques_by_joint.items():
    print(f"{name:12s} {torque:+.4f} N m")

problem = scene.problem()  # the arrays behind it
print(problem, problem.J.shape)
