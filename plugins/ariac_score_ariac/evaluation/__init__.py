"""The organisers' evaluation of 2023 and 2024, and where it differs from ours."""
