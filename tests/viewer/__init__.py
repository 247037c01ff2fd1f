"""Tests of the viewer wait for events; only what will never come is given up."""

WATCHDOG_S = 1800.0
