"""The cheapest model of a scene that meets a tolerance."""
