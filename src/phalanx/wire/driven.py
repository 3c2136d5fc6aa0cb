"""Records of robots that visitors drive: orders, and their controller's memory. Part of the byte table (table.py).

x points right, y down (docs/spec/vocabulary.md). docs/spec/orders.md says which orders a robot obeys.
"""

from __future__ import annotations

from .record import fields, record

KIND_ORDER = 0x04
# Actions of an order: beacon, turn wheels, show a colour, follow a route, stop, end the stop.
TELL_NOTHING, TELL_WHEELS, TELL_LED, TELL_ROUTE, TELL_STOP, TELL_GO = range(6)
EVERYBODY = 0  # the id in an order to all robots
GATEWAY, OPERATOR = 0, 1  # indices of the signers, in the order of the mission's keys
SIGNERS = 2
SIGNER_KEY_BYTES = 32  # Ed25519
SIGNATURE_BYTES = 64

POSE = fields("x_mm y_mm f32: position", "direction_deg f32: the nose points along (-sin, cos)")
LED = fields("red green blue u8")
WHEELS = fields("left i8: percent", "right i8: percent")

ORDER = record(
    "order: signed command of a gateway or an operator to robots",
    "mission u32: sequence number of the mission key",
    "signer u8: 0 the gateway, 1 the operator",
    "number u64: greater than in this signer's earlier orders of the mission; 0 in a stop",
    "said u64: ms, signer's clock; later than in its earlier orders",
    "id u16: robot id, 0 for all robots",
    "action u8: 0 nothing, 1 wheels, 2 LED, 3 route, 4 stop, 5 go",
    "body rest: parameters of the action, then the signature over all bytes before it, 64 bytes",
    tag=KIND_ORDER,
)
ORDER_WHEELS = record("order_wheels: parameters of an order: turn the wheels for a moment", *WHEELS)
ORDER_LED = record("order_led: parameters of an order: show a colour", *LED)
ORDER_ROUTE = record(
    "order_route: parameters of an order: visit these points",
    "threshold_mm u16: distance at which a point counts as reached",
    "count u8: number of points; 0 ends the route",
    "points rest: `count` waypoints",
)
WAYPOINT = record("waypoint: a point of a route", "x_mm y_mm u16")

SIGNER = record(
    "signer: a signer that a robot obeys, and its last orders",
    "key b32: Ed25519 public key from the mission; zeros: no such signer",
    "number u64: highest number in its orders",
    "said u64: ms, signer's clock in its latest order",
    "least i64: ms, smallest difference between the robot's clock at arrival and an order's `said`; 2^62: none yet",
    "learnt u64: ms, when `least` was measured",
)
WHEELS_MEMORY = record(
    "wheels_memory: memory of a driven robot's controller",
    *POSE,
    "left i8: percent, from the last wheels order",
    "right i8: percent, from the last wheels order",
    "heard u64: ms, when that order arrived",
    *LED,
    "held u8: bits: 1 stopped by the gateway, 2 stopped by the operator",
    "checks u8: signatures checked since the last reading",
    "signers b128: two records `signer`: gateway, operator",
    "threshold_mm u16: distance at which a point counts as reached",
    "count u8: points left of the route",
    "route rest: `count` waypoints",
)
ROBOT_NEARBY = record(
    "robot_nearby: a robot that a driven robot senses; each reading ends with four of them",
    "x_mm y_mm i16: position relative to the driven robot's centre; both 0: none",
)
ORDERS = (ORDER, ORDER_WHEELS, ORDER_LED, ORDER_ROUTE, WAYPOINT)
REMEMBERED = (WHEELS_MEMORY, SIGNER, ROBOT_NEARBY)
