"""What is strained, led back within the bounds before shares of it are given up."""
