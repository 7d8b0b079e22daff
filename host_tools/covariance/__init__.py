"""Linear covariance analysis: σ of the position over time and each source's share, without runs."""
