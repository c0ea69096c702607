"""The report of a mission is told as a table."""

from pa_console.session.trace.execution import report_table

REPORT = """\
M001-ab verified: Look at the vehicle.
Raised by A001 (high) at 300 s: an unknown vehicle approaches NorthGate
Rules: ROE-02, WF-03
Plan 1 for 'Look there.'. Rationale: It was not seen: look first.
- Drone_T04 observe NorthGate: pass, seen there
By telemetry as of 312.5 s: pass, all actions seen
All gates covered.
"""


def test_every_line_of_a_report_is_a_row_with_what_it_is_about_first() -> None:
    rows = [tuple(span.text for span in row) for row in report_table(REPORT).rows]
    assert rows == [
        ("M001-ab verified", "Look at the vehicle."),
        ("Raised by A001 (high) at 300 s", "an unknown vehicle approaches NorthGate"),
        ("Rules", "ROE-02, WF-03"),
        ("Plan 1 for 'Look there.'", "Rationale: It was not seen: look first."),
        ("Drone_T04 observe NorthGate", "pass, seen there"),
        ("By telemetry as of 312.5 s", "pass, all actions seen"),
        ("Gates", "all covered"),
    ]


def test_an_empty_report_has_no_row_and_a_strange_line_stays_whole() -> None:
    assert report_table("").rows == ()
    (row,) = report_table("nothing to say").rows
    assert [span.text for span in row] == ["", "nothing to say"]
