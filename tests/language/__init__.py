"""Tests of pa_console.language."""
