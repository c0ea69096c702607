"""Training on one large GPU for some minutes: everything lies ready, nothing is fetched there."""
