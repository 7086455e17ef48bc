"""Work while nothing moves: errors measured, light gathered, references kept."""
