"""Steps 2 to 6: from a mission's words to a plan that was checked, judged and decided on."""
