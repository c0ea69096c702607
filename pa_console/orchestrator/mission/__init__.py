"""One mission through its eight steps, from its words to its report."""
