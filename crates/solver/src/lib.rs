//! Systems of contacts.
