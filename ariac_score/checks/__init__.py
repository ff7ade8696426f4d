"""What a check is: findings, contracts, parameters, and how plugins are found, built and held to them."""
