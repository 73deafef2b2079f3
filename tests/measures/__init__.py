"""Measures of a repair that share nothing with the code they judge: numpy, scipy and CGAL.

The benchmarks use them too; `benchmarks.characters` prints them as a table.
"""
