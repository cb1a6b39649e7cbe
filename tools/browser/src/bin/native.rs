//! Prints the hashes that the module has to return.

fn main() {
    for certified in [false, true] {
        println!("{:016x}", browser::hash(certified, 90));
    }
}
