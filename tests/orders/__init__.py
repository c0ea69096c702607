"""Tests of pa_console.orders."""
