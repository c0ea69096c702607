"""A plan before it runs: who goes where and when, as its rehearsal has shown."""
