"""Key poses whose in-betweens are clean too."""
