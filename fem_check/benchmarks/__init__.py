"""Problems with known answers, and their cost."""
