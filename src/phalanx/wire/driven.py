"""The byte table's page of robots that visitors drive: orders, and what such a robot remembers.

x to the right, y down (docs/spec/vocabulary.md); who may order what, and what a robot checks: docs/spec/orders.md.
"""

from __future__ import annotations

from .record import Field, Record

KIND_ORDER = 0x04
# Actions of an order: the beacon; wheels, LED and route; everybody stands still, and may move again.
TELL_NOTHING, TELL_WHEELS, TELL_LED, TELL_ROUTE, TELL_STOP, TELL_GO = range(6)
EVERYBODY = 0  # to whom an order may be, beside one robot
GATEWAY, OPERATOR = 0, 1  # whose keys a mission names, in this order
SIGNERS = 2
SIGNER_KEY_BYTES = 32  # Ed25519
SIGNATURE_BYTES = 64

POSE = (
    Field("x_mm", "f32", "position"),
    Field("y_mm", "f32", ""),
    Field("direction_deg", "f32", "the nose points along (-sin, cos)"),
)
LED = (Field("red", "u8", ""), Field("green", "u8", ""), Field("blue", "u8", ""))
WHEELS = (Field("left", "i8", "percent"), Field("right", "i8", "percent"))

ORDER = Record(
    "order",
    (
        Field("mission", "u32", "its number, as the mission key has it"),
        Field("signer", "u8", "0 the gateway, 1 the operator"),
        Field("number", "u64", "above all that this signer has said in the mission; 0 of a stop"),
        Field("said", "u64", "ms, the signer's clock; above all before"),
        Field("id", "u16", "of the robot that is told, 0 for all"),
        Field("action", "u8", "0 nothing, 1 wheels, 2 LED, 3 route, 4 stop, 5 go"),
        Field("body", "rest", "as the action has it; then the signature of all before it, 64 bytes"),
    ),
    "what a gateway or an operator tells robots",
    KIND_ORDER,
)
ORDER_WHEELS = Record("order_wheels", WHEELS, "body of an order: turn the wheels for a moment")
ORDER_LED = Record("order_led", LED, "body of an order: show a colour")
ORDER_ROUTE = Record(
    "order_route",
    (
        Field("threshold_mm", "u16", "how near counts as reached"),
        Field("count", "u8", "of points; 0 stops"),
        Field("points", "rest", "as many waypoints"),
    ),
    "body of an order: visit these points",
)
WAYPOINT = Record("waypoint", (Field("x_mm", "u16", ""), Field("y_mm", "u16", "")), "a point of a route")

SIGNER = Record(
    "signer",
    (
        Field("key", "b32", "Ed25519, as the mission names it; zeros for nobody"),
        Field("number", "u64", "the highest of its orders"),
        Field("said", "u64", "ms, its clock at the latest of them"),
        Field("least", "i64", "ms from its word to its arrival, each by its own clock, at least; 2^62: never heard"),
        Field("learnt", "u64", "ms, when that was"),
    ),
    "whom a robot obeys, and what it heard of it",
)
WHEELS_MEMORY = Record(
    "wheels_memory",
    (
        *POSE,
        Field("left", "i8", "percent, the last joystick's word"),
        Field("right", "i8", "the same"),
        Field("heard", "u64", "ms, when that came"),
        *LED,
        Field("held", "u8", "1, 2: the gateway, the operator has it stand still"),
        Field("checks", "u8", "of signatures, since the last reading"),
        Field("signers", "b128", "gateway and operator, a signer each"),
        Field("threshold_mm", "u16", "how near counts as reached"),
        Field("count", "u8", "of points left of the route"),
        Field("route", "rest", "as many waypoints"),
    ),
    "what a driven robot's controller remembers",
)
ORDERS = (ORDER, ORDER_WHEELS, ORDER_LED, ORDER_ROUTE, WAYPOINT)
REMEMBERED = (WHEELS_MEMORY, SIGNER)
