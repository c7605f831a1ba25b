"""The command line as tests run it: in this process, with what it printed and its exit code."""

import json
import sys

from typer.testing import CliRunner

from palpate.render.cli.app import app

PALPATE = [sys.executable, "-P", "-c", "from palpate.render.cli.app import main; main()"]
FAILED, MISUSED = 1, 2


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)


def answer(*arguments):
    """JSON of a command that succeeds."""
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refused(code, message, *arguments):
    """A command that must fail with this code and one sentence, the same in JSON."""
    result = run(*arguments)
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    told = " ".join(result.stderr.split())
    assert message in told, told
    assert json.loads(run(*arguments, "--json").stdout)["error"]
