"""Robot files, their list, and audits of URDFs."""
