//! Energy terms of eqs. 3 and 4, one file per term (in progress).
