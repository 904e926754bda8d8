"""Case files: tables of TOML that become a Case, or one sentence about each mistake."""
