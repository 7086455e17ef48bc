"""Light as it is drawn where receivers have none of their own, and at probes."""
