"""The byte table's page of robots that visitors drive: orders, and what such a robot remembers.

x to the right, y down (docs/spec/vocabulary.md); who may order what, and what a robot checks: docs/spec/orders.md.
"""

from __future__ import annotations

from .record import fields, record

KIND_ORDER = 0x04
# Actions of an order: the beacon; wheels, LED and route; everybody stands still, and may move again.
TELL_NOTHING, TELL_WHEELS, TELL_LED, TELL_ROUTE, TELL_STOP, TELL_GO = range(6)
EVERYBODY = 0  # to whom an order may be, beside one robot
GATEWAY, OPERATOR = 0, 1  # whose keys a mission names, in this order
SIGNERS = 2
SIGNER_KEY_BYTES = 32  # Ed25519
SIGNATURE_BYTES = 64

POSE = fields("x_mm y_mm f32: position", "direction_deg f32: the nose points along (-sin, cos)")
LED = fields("red green blue u8")
WHEELS = fields("left i8: percent", "right i8: percent")

ORDER = record(
    "order: what a gateway or an operator tells robots",
    "mission u32: its number, as the mission key has it",
    "signer u8: 0 the gateway, 1 the operator",
    "number u64: above all that this signer has said in the mission; 0 of a stop",
    "said u64: ms, the signer's clock; above all before",
    "id u16: of the robot that is told, 0 for all",
    "action u8: 0 nothing, 1 wheels, 2 LED, 3 route, 4 stop, 5 go",
    "body rest: as the action has it; then the signature of all before it, 64 bytes",
    tag=KIND_ORDER,
)
ORDER_WHEELS = record("order_wheels: body of an order: turn the wheels for a moment", *WHEELS)
ORDER_LED = record("order_led: body of an order: show a colour", *LED)
ORDER_ROUTE = record(
    "order_route: body of an order: visit these points",
    "threshold_mm u16: how near counts as reached",
    "count u8: of points; 0 stops",
    "points rest: as many waypoints",
)
WAYPOINT = record("waypoint: a point of a route", "x_mm y_mm u16")

SIGNER = record(
    "signer: whom a robot obeys, and what it heard of it",
    "key b32: Ed25519, as the mission names it; zeros for nobody",
    "number u64: the highest of its orders",
    "said u64: ms, its clock at the latest of them",
    "least i64: ms from its word to its arrival, each by its own clock, at least; 2^62: never heard",
    "learnt u64: ms, when that was",
)
WHEELS_MEMORY = record(
    "wheels_memory: what a driven robot's controller remembers",
    *POSE,
    "left i8: percent, the last joystick's word",
    "right i8: the same",
    "heard u64: ms, when that came",
    *LED,
    "held u8: 1, 2: the gateway, the operator has it stand still",
    "checks u8: of signatures, since the last reading",
    "signers b128: gateway and operator, a signer each",
    "threshold_mm u16: how near counts as reached",
    "count u8: of points left of the route",
    "route rest: as many waypoints",
)
ROBOT_NEARBY = record(
    "robot_nearby: a robot that a driven one senses; a reading ends with four",
    "x_mm y_mm i16: from its middle; 0: none",
)
ORDERS = (ORDER, ORDER_WHEELS, ORDER_LED, ORDER_ROUTE, WAYPOINT)
REMEMBERED = (WHEELS_MEMORY, SIGNER, ROBOT_NEARBY)
