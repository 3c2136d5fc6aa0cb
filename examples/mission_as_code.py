"""Write a mission as code, encode it, and let a robot without a map carry it out: python examples/mission_as_code.py"""

import os

from phalanx.mission import Action, BuildOptions, Draft, Experience, Landmark, Position, Sensor, State, Walker, build

# The operator's side: three nodes, and the robot's actions there.
draft = Draft("fetch")
draft.node("dock", Position(3.0, 1.5), start=True)
draft.node("store", Landmark("doorway", 9.0, 12.0, 1.57), do=Action("pick", (("shelf", 3),)))
draft.node("hand-over", (Position(10.6, 13.5), Sensor(b"green light")), final=True)
draft.way("dock", "store")
draft.way("store", "hand-over")
(built,) = build(draft.mission(), BuildOptions(), os.urandom)
print(f"{len(built.mission.encode())} bytes, sealed: no place, no name and no action can be read in them")

# The robot's side: its observations, step by step. Odometry is off by a few centimetres and degrees.
experiences = {
    "at the dock": Experience(0.0, 3.0, 1.5, 1.0),
    "lost in a corridor": Experience(1.0, 30.0, 30.0, 1.0, 4.0, (Landmark("doorway", 30.2, 31.0, 0.0),)),
    "before the store's door": Experience(20.0, 7.1, 9.0, 1.0, 8.6, (Landmark("doorway", 9.1, 12.1, 1.5),)),
    "in front of the light": Experience(40.0, 10.5, 13.4, 1.0, 12.0, sensors=(b"red light", b"green light")),
}
walker, state = Walker(built.mission, built.key), State()
for where, seen in experiences.items():
    state, said = walker.step(state, seen)
    if said.decoded:
        do = f", do {said.decoded.do.name}" if said.decoded.do else ""
        print(f"{where}: decoded {said.decoded.name!r} in {said.trials} tries{do}; now {said.order.kind.value}")
    else:
        print(f"{where}: not validated, {said.reason.value if said.reason else ''}; now {said.order.kind.value}")
    if said.fix:
        print(f"    the odometry was off by {said.fix.moved_m:.2f} m and {said.fix.turned_rad:+.2f} rad")
