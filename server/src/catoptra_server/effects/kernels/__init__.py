"""What effects are made of: mathematics that knows no configuration, no criterion, no table."""
