"""Where the boat is: models, filters, noise adaptation, and the timeline that feeds them in order of time."""
