"""Episodes of members that learn, in processes without Gymnasium: parents that have warmed up, and forks of them."""
