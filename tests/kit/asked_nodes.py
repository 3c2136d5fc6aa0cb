"""Trusted nodes asked one call at a time, bytes in and bytes out: as the tests tell what each of them answers."""

from __future__ import annotations

import numpy as np

from phalanx.bti import nodes, trusted
from phalanx.bti.nodes import Refused
from phalanx.wire.table import ENTRY_HEADER_BYTES, MAC_BYTES, PACKET_MAX


class Nodes(nodes.Nodes):
    """Robots are known by their row; each method raises Refused, and then nothing has happened."""

    def power_up(self, i):
        """Both nodes of robot i have lost what was in RAM."""
        self._lib.phx_snode_power_up(self._s(i))
        self._lib.phx_anode_power_up(self._a(i))

    def check_all(self, now_ms):
        """CheckTokens of every a-node, each by its robot's own clock; 1 in Safe Mode."""
        return [self._lib.phx_anode_check(self._a(i), int(now)) for i, now in enumerate(now_ms)]

    def is_safe(self, i):
        """Whether robot i is in Safe Mode."""
        return bool(self._lib.phx_anode_is_safe(self._a(i)))

    def poll(self, i, now, reading):
        """The entry of a sensor reading, chained."""
        return self._forward(trusted.snode_poll, self.snode[i], now, reading)

    def recv(self, i, now, packet):
        """The entry of a packet from the radio."""
        return self._forward(trusted.anode_recv, self.anode[i], now, packet)

    def send(self, i, now, packet):
        """The entry of a packet to the radio; on air goes what is behind its header."""
        return self._forward(trusted.anode_send, self.anode[i], now, packet)

    def actuate(self, i, now, command):
        """The entry of a command to the actuators."""
        return self._forward(trusted.anode_actuate, self.anode[i], now, command)

    def _forward(self, function, node, now, payload):
        entry = np.zeros(ENTRY_HEADER_BYTES + min(len(payload), PACKET_MAX), np.uint8)
        return bytes(entry[: _checked(function(self.profile, node, now, _row(payload), len(payload), entry))])

    def make_auth(self, i, nonce):
        """The record `authenticator` of the s-chain."""
        out = np.zeros(trusted.AUTH_BYTES, np.uint8)
        _checked(trusted.snode_make_auth(self.profile, self.snode[i], _row(nonce), out))
        return out.tobytes()

    def check_auth(self, i, top, robot_id, nonce, mac):
        """Robot i's s-node knows the authenticator for good."""
        rows = _row(top), robot_id, _row(nonce), _row(mac)
        _checked(trusted.snode_check_auth(self.profile, self.snode[i], *rows))

    def make_auth_a(self, i):
        """`paper` only: the record `authenticator` of the a-chain."""
        out = np.zeros(trusted.AUTH_BYTES, np.uint8)
        _checked(trusted.anode_make_auth(self.profile, self.anode[i], out))
        return out.tobytes()

    def check_auth_a(self, i, top, robot_id, mac):
        """`paper` only: robot i's s-node knows an a-node's authenticator for good."""
        _checked(trusted.snode_check_auth_a(self.profile, self.snode[i], _row(top), robot_id, _row(mac)))

    def token_request(self, i, now, auditor):
        """The record `token_request`."""
        out = np.zeros(trusted.TREQ_BYTES, np.uint8)
        _checked(trusted.anode_token_request(self.profile, self.anode[i], now, auditor, out))
        return out.tobytes()

    def issue_token(self, i, auditee, t, top, treq_mac, hckpt):
        """The MAC of robot i's token for `auditee`."""
        mac = np.zeros(MAC_BYTES, np.uint8)
        rows = _row(top), _row(treq_mac), _row(hckpt), mac
        _checked(trusted.anode_issue_token(self.profile, self.anode[i], auditee, t, *rows))
        return mac.tobytes()

    def check_token(self, i, auditor, auditee, t, hckpt, mac):
        """Robot i's a-node knows the token for good."""
        _checked(trusted.anode_check_token(self.profile, self.anode[i], auditor, auditee, t, _row(hckpt), _row(mac)))

    def install_token(self, i, now, auditor, t, hckpt, mac):
        """Robot i's a-node counts the token."""
        _checked(trusted.anode_install_token(self.profile, self.anode[i], now, auditor, t, _row(hckpt), _row(mac)))


def _row(raw):
    return np.frombuffer(bytearray(raw), np.uint8)


def _checked(code):
    if code < 0:
        raise Refused(code)
    return code
