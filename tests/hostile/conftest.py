"""What the attacks share, and the counts of cases that are printed at the end."""

from __future__ import annotations

from collections import Counter
from functools import cache

import pytest
from kills import undisturbed
from oracle import COUNTS, SAME
from processes import Server
from small_runs import RUNS, make_inputs
from tally import NEED_MOUNT, NO_MOUNT, missing, table

KEY = "hostile cases"  # of the property of a report that holds its counts


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """Starts commands in processes of their own."""
    folder = tmp_path_factory.mktemp("printed")
    folder.parent.chmod(0o755)
    server = Server(folder)
    yield server
    server.close()


@pytest.fixture(scope="session")
def inputs(tmp_path_factory, server):
    """Paths of a dataset, a network and weights."""
    return make_inputs(tmp_path_factory.mktemp("inputs"), server)


@pytest.fixture(scope="session")
def whole(tmp_path_factory, server, inputs):
    """What a command does that nothing disturbs, by its name."""
    return cache(lambda command: undisturbed(server, RUNS[command], inputs, tmp_path_factory.mktemp(command)))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item, call):
    """Add to the report of a test how many cases it tried; the reports of workers reach the process that prints."""
    if call.when == "call":
        item.user_properties.append((KEY, [[*key, number] for key, number in COUNTS.items()]))
        COUNTS.clear()


def _counts(reporter) -> Counter:
    counts: Counter = Counter()
    for reports in reporter.stats.values():
        for report in reports:
            if getattr(report, "when", None) == "call":
                for name, rows in report.user_properties:
                    if name == KEY:
                        counts.update({(attacked, kind): number for attacked, kind, number in rows})
    return counts


def _untried(reporter, counts: Counter) -> list[str]:
    """Return the kinds of attack that were skipped, since nothing may be mounted here."""
    if not any(NO_MOUNT in str(report.longrepr) for report in reporter.stats.get("skipped", ())):
        return []
    return [kind for kind in NEED_MOUNT if not any(kind == tried for _, tried in counts)]


def pytest_terminal_summary(terminalreporter):
    """Print the counts by what is attacked and kind of attack, and what a whole campaign lacks."""
    if SAME:
        return
    counts = _counts(terminalreporter)
    terminalreporter.section("cases")
    terminalreporter.write_line(table(counts))
    untried = _untried(terminalreporter, counts)
    for kind in untried:
        terminalreporter.write_line(f"not tried: {kind} ({NO_MOUNT})")
    for lack in missing(counts, untried) if _is_whole(terminalreporter.config) else ():
        terminalreporter.write_line(f"too few: {lack}")


def _is_whole(config) -> bool:
    """Return whether all of the campaign was asked for."""
    return not SAME and not config.option.keyword and config.args[-1].endswith("hostile")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    """Let a whole campaign fail that tried fewer cases than it promises."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or exitstatus != 0 or not _is_whole(session.config):
        return
    counts = _counts(reporter)
    if missing(counts, _untried(reporter, counts)):
        session.exitstatus = 1
