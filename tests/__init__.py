"""The tests.

This file makes them a package. Without it, worker processes import the package `tests` that json-checker, a dependency
of mccnn, installs in site-packages, and do not find the functions of these tests.
"""
