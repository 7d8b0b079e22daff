"""Linear covariance analysis: σ of the navigation over time and each source's share."""
