import io
import os

import pytest

from basenet_jax.progress import PlainReporter, TerminalReporter, make_reporter


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_plain_lines_come_first_at_a_sane_interval_and_last() -> None:
    stream, clock = io.StringIO(), Clock()
    reporter = PlainReporter(stream, every_s=10.0, clock=clock)
    reporter.start("base-pose", 20, unit="samples", work=5000.0)
    reporter.stage("compiling ...")
    clock.now += 60.0  # compilation does not spoil the rate
    for done in range(1, 21):
        reporter.update(done, {"success": 0.5 + done / 100, "loss": 123456.789})
        clock.now += 4.0
    reporter.finish()
    assert stream.getvalue().splitlines() == [
        "base-pose: compiling ...",
        "base-pose: 1/20 (5 %), 0:01:00 elapsed, success 0.51, loss 1.235e+05",
        "base-pose: 4/20 (20 %), 0:01:12 elapsed, 1.25k samples/s, 0:01:04 left, success 0.54, loss 1.235e+05",
        "base-pose: 7/20 (35 %), 0:01:24 elapsed, 1.25k samples/s, 0:00:52 left, success 0.57, loss 1.235e+05",
        "base-pose: 10/20 (50 %), 0:01:36 elapsed, 1.25k samples/s, 0:00:40 left, success 0.6, loss 1.235e+05",
        "base-pose: 13/20 (65 %), 0:01:48 elapsed, 1.25k samples/s, 0:00:28 left, success 0.63, loss 1.235e+05",
        "base-pose: 16/20 (80 %), 0:02:00 elapsed, 1.25k samples/s, 0:00:16 left, success 0.66, loss 1.235e+05",
        "base-pose: 19/20 (95 %), 0:02:12 elapsed, 1.25k samples/s, 0:00:04 left, success 0.69, loss 1.235e+05",
        "base-pose: 20/20 (100 %), 0:02:16 elapsed, 1.25k samples/s, 0:00:00 left, success 0.7, loss 1.235e+05",
    ]


def test_the_newest_line_is_told_when_work_ends_early() -> None:
    stream, clock = io.StringIO(), Clock()
    reporter = PlainReporter(stream, clock=clock)
    reporter.start("a", 20)
    for done in (1, 2, 3):
        reporter.update(done, {})
        clock.now += 1.0
    reporter.start("b", 2, 1)
    reporter.update(2, {})
    reporter.finish()
    reporter.finish()
    counts = [line.split(",")[0] for line in stream.getvalue().splitlines()]
    assert counts == ["a: 1/20 (5 %)", "a: 3/20 (15 %)", "b: 2/2 (100 %)"]


def test_a_resumed_work_has_its_own_rate() -> None:
    stream, clock = io.StringIO(), Clock()
    reporter = PlainReporter(stream, every_s=0.0, clock=clock)
    reporter.start("a", 100, 90)
    for done in (91, 92):
        reporter.update(done, {})
        clock.now += 2.0
    assert stream.getvalue().splitlines()[-1] == "a: 92/100 (92 %), 0:00:02 elapsed, 0.5 intervals/s, 0:00:16 left"


def test_notes_and_stages_need_no_work_under_way() -> None:
    for reporter in (PlainReporter(plain := io.StringIO()), TerminalReporter(terminal := Terminal())):
        reporter.stage("loading [bold] ...")
        reporter.note("checkpoint 000012 is damaged")
        reporter.update(1, {})
        reporter.finish()
    for stream in (plain, terminal):
        assert stream.getvalue().splitlines() == ["loading [bold] ...", "checkpoint 000012 is damaged"]


def test_a_terminal_gets_a_bar_and_stdout_stays_free(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    stream, clock = Terminal(), Clock()
    reporter = TerminalReporter(stream, clock=clock)
    reporter.start("base-pose", 20, unit="samples", work=5000.0)
    reporter.stage("compiling ...")
    for done in (1, 2):
        reporter.update(done, {"success": 0.5})
        clock.now += 4.0
    print("on stdout")
    reporter.note("a note")
    reporter.finish()
    shown = stream.getvalue()
    assert "base-pose" in shown
    assert " 2/20" in shown
    assert "1.25k samples/s, 0:01:12 left, success 0.5" in shown
    assert "a note" in shown
    assert "on stdout" not in shown
    assert capfd.readouterr() == ("on stdout\n", "")


def test_the_reporter_suits_the_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    assert isinstance(make_reporter(io.StringIO()), PlainReporter)
    assert isinstance(make_reporter(Terminal()), TerminalReporter)
    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(make_reporter(Terminal()), PlainReporter)


def test_plain_lines_go_to_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    make_reporter().note(f"process {os.getpid()}")
    assert capfd.readouterr() == ("", f"process {os.getpid()}\n")
