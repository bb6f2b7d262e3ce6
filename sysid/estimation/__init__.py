"""From a chain and a record to a `Fit`: objective, problem, initial states, starts, the fit and its file."""
