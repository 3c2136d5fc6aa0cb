"""Template, an attack: phalanx attack run template.py

The same without a defence, with a robot and a time of your choice:
phalanx attack run template.py:robot=3,at=10 --defence none
"""

from dataclasses import replace

from phalanx.robot import Act, Action, Liar, Send, State


class Template(Liar):
    """broadcasts that it is 10 m further north than it is"""

    def send_output(self, now_ms: int, output: Act | Send) -> list[Action]:
        """Alter an output of the robot's controller: `Act` for the motors, `Send` for the radio.

        Return [] to suppress the output. `self.plan` and `self.seen` contain what the adversary knows.
        """
        state = State.find(output.payload) if isinstance(output, Send) else None
        if state and self.lies(now_ms):
            output = Send(replace(state, y_m=state.y_m + 10.0).encode())
        return super().send_output(now_ms, output)
