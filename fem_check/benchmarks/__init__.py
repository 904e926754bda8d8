"""Problems with known answers, and what solving them costs."""
