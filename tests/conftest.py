"""What every test shares: small hypothesis runs by default, so that the whole suite stays quick on two cores."""

import os
import signal
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, settings

from tests import give_way, own_terminals

settings.register_profile("quick", max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("quick")


WHY_NO_TERMINALS = pytest.StashKey[str | None]()


def pytest_configure(config: pytest.Config) -> None:
    """Each process that runs tests has pseudo-terminals of its own, where it may, and nobody's settings.

    Workers give way when asked to.
    """
    config.stash[WHY_NO_TERMINALS] = own_terminals.take()
    nowhere = TemporaryDirectory(prefix="wayfix-tests-")
    config.add_cleanup(nowhere.cleanup)
    os.environ["XDG_CONFIG_HOME"] = nowhere.name
    if os.environ.get("WAYFIX_GIVE_WAY") and hasattr(config, "workerinput"):
        give_way.to_all()


def pytest_report_header(config: pytest.Config) -> str | None:
    """Said once where they are not to be had."""
    why = config.stash[WHY_NO_TERMINALS]
    return f"pseudo-terminals: {why}" if why else None


def pytest_sessionstart() -> None:
    """A shell starts background jobs with SIGINT ignored, and so would be the programs that the tests interrupt."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Where nothing may be missing (CI sets WAYFIX_NO_SKIP) a skipped test is a failure."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("WAYFIX_NO_SKIP") and reporter is not None and reporter.stats.get("skipped"):
        reporter.write_line("WAYFIX_NO_SKIP is set and tests were skipped: that is a failure here", red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
