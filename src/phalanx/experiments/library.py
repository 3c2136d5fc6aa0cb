"""All figures and tables of the papers that are reproduced here."""

from __future__ import annotations

from functools import partial

from .figure import Figure, Option

BROKER = Option("broker", "auto", "auto, mosquitto, amqtt, or a mqtt(s):// or ws(s):// URL.")
DURATION = Option(
    "duration",
    60.0,
    "Seconds to measure for, earlier runs into the same folder included; the paper's is 54000.",
    1.0,
    30 * 86_400.0,
)
flock = partial(Figure, counted="runs", size_in=(11.0, 8.4))

FIGURES = {
    figure.name: figure
    for figure in (
        Figure(
            name="link-fig4",
            about="Packets lost and late through a broker, plain and sealed (Qrkey Fig. 4)",
            made_by="link.fig4",
            options=(BROKER, DURATION),
            quick={"duration": 10.0},
            has_login=True,
            alone=True,
            example="--broker mqtts://broker.hivemq.com:8883 --duration 54000 (the paper's)",
            counted="packets of each kind",
            size_in=(11.0, 5.4),
        ),
        flock(
            name="bti-fig2",
            about="Ten of 125 robots lie among obstacles, and the flock stays away (RoboRebound Fig. 2)",
            made_by="bti.fig2:FLOCK",
        ),
        Figure(
            name="bti-fig5",
            about="What a MAC and a hash cost on microcontrollers (RoboRebound Fig. 5a)",
            made_by="bti.fig5",
            alone=True,
        ),
        Figure(
            name="bti-table1",
            about="Worst load of the a-node, call by call (RoboRebound Table 1)",
            made_by="bti.loads:TABLE1",
        ),
        Figure(
            name="bti-table2",
            about="Worst load of the s-node, call by call (RoboRebound Table 2)",
            made_by="bti.loads:TABLE2",
        ),
        Figure(
            name="bti-fig6",
            about="What audits send and keep, by f_max and T_audit (RoboRebound Fig. 6)",
            made_by="bti.fig6",
            counted="runs",
            size_in=(12.0, 5.8),
        ),
        Figure(
            name="bti-fig7",
            about="What audits send and keep in denser flocks and in larger ones (RoboRebound Fig. 7)",
            made_by="bti.fig7",
            counted="runs",
            size_in=(12.0, 8.6),
        ),
        flock(
            name="bti-fig8",
            about="One robot lies and nobody stops it: the flock stays away (RoboRebound Fig. 8)",
            made_by="bti.fig8:FLOCK",
        ),
        flock(
            name="bti-fig9",
            about="One robot lies and the others stop it: the flock arrives (RoboRebound Fig. 9)",
            made_by="bti.fig9:FLOCK",
        ),
        Figure(
            name="mission-fig8a",
            about="A path of 150 s recovered by odometry and by encoded landmarks (Encoded graphs Fig. 8a)",
            made_by="missions.fig8a",
            size_in=(12.0, 6.0),
        ),
        Figure(
            name="mission-fig8b",
            about="Localisation error for growing noise of the odometry (Encoded graphs Fig. 8b)",
            made_by="missions.fig8b",
            size_in=(16.0, 5.5),
        ),
        Figure(
            name="mission-fig8c",
            about="Time to find landmarks in a scan and to search their hashes (Encoded graphs Fig. 8c)",
            made_by="missions.fig8c",
            alone=True,
        ),
        Figure(
            name="mission-fig9",
            about="Four robots explore together and share hashes alone (Encoded graphs Fig. 9)",
            made_by="missions.fig9",
            size_in=(12.0, 6.5),
        ),
        Figure(
            name="mission-table1",
            about="How knowledge is divided among four exploring robots (Encoded graphs Table I)",
            made_by="missions.table1",
        ),
        Figure(
            name="mission-fig10",
            about="An office with QR codes, by camera (Encoded graphs Fig. 10)",
            made_by="missions.fig10",
            alone=True,
            size_in=(16.0, 6.0),
        ),
    )
}
