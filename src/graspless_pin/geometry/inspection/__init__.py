"""What is known about robots before they are used: listings and audits of their files."""
