"""First generator of concealed campaigns, independent of the package under test."""
