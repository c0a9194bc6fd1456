"""Lines of the control protocol for reports in replies, without line ends."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.reports import Report, line_from_report
from catoptra_server.runtime.memory import LruDict

log = logging.getLogger(__name__)

# Reports of 16 robots with 16 sensors each, at most 1 MB of lines.
_MAX_REPORTS = 256


class ReportLines:
    """Lines of the reports that several clients read, made once; on the loop."""

    def __init__(self) -> None:
        # By identity, since hashing a scan takes as long as its line. The report is kept beside
        # its lines, so that no other one gets its identity.
        self._lines: LruDict[int, tuple[Report, tuple[str, ...]]] = LruDict(_MAX_REPORTS)

    def __len__(self) -> int:
        """Number of reports whose lines are kept."""
        return len(self._lines)

    def get(self, reports: Iterable[Report]) -> tuple[str, ...]:
        """Lines of reports; none for a report without a valid line."""
        return tuple(line for report in reports for line in self._get_one(report))

    def _get_one(self, report: Report) -> tuple[str, ...]:
        def make() -> tuple[Report, tuple[str, ...]]:
            return report, lines_from_reports([report])

        return self._lines.get_or_make(id(report), make)[1]


def lines_from_reports(reports: Iterable[Report]) -> tuple[str, ...]:
    """Lines of the control protocol, without reports that have no valid line."""
    lines: list[str] = []
    for report in reports:
        try:
            lines += line_from_report(report).decode("latin-1").splitlines()
        except LocalProtocolError as error:
            log.error("not sent: %s", error)
    return tuple(lines)
