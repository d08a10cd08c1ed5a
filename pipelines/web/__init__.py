"""Local pages: who may come in, how they are served, and work behind them."""
