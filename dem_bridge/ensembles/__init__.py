"""Many chains that differ in numbers only: drawn, solved in compiled batches, and checked on a sample."""
