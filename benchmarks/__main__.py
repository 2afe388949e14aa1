"""Print the tables of all sections, or of those named: ``python -m benchmarks [SECTION ...]``."""

import argparse
import time

from benchmarks import (
    carried,
    commands,
    cones,
    geometry,
    holding,
    interfaces,
    many,
    planning,
    searches,
    studies,
    uncertain,
    verdicts,
)

# Each section is a function without arguments that returns markdown.
SECTIONS = {
    "paper": searches.paper_scenes,
    "random": searches.random_scenes,
    "rivals": searches.rivals,
    "cones": cones.round_cones,
    "directions": cones.directions,
    "geometry": geometry.scene_problem,
    "planning": planning.evaluator,
    "many": many.many_states,
    "carried": carried.carried,
    "interfaces": interfaces.interfaces,
    "studies": studies.cuboid_study,
    "holding": holding.holding,
    "uncertain": uncertain.uncertain,
    "verdicts": verdicts.verdicts,
    "commands": commands.commands,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    names = parser.parse_args().sections or list(SECTIONS)
    unknown = [name for name in names if name not in SECTIONS]
    if unknown:
        parser.error(f"no section {', '.join(unknown)}; there are {', '.join(SECTIONS)}")
    start = time.perf_counter()
    for name in names:
        print(SECTIONS[name](), end="\n\n", flush=True)
    print(f"Measured in {time.perf_counter() - start:.0f} s.")


if __name__ == "__main__":
    main()
