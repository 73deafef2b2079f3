"""What is worn: which connected part lies over, or goes round, which other one."""
