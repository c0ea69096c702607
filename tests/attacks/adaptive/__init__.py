"""An attacker that learns: it rewrites orders and histories, and keeps what comes nearest to harm.

`words` disguises orders that the rules refuse; `histories` takes planner and operator to be on its
side and looks for a history of orders and events that does harm. `search` keeps and rewrites what
came nearest. `python -m tests.attacks words --count 1000` is a campaign by hand.
"""
