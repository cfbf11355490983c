"""Imports the tests of ``tests/exchange``, once for all processes that begin as a copy of this one."""

from tests.verify.mutants_by_tests import TESTS, run_pytest

run_pytest("--collect-only", str(TESTS))
