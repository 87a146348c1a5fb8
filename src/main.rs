fn main() {
    println!("hush {}", env!("CARGO_PKG_VERSION"));
}
