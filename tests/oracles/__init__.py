"""Slow, plain float64 implementations of the world's definitions, one instance at a time, to judge the package by.

They are written from the definitions alone, by other methods than the package's, and share no code with it.
"""
