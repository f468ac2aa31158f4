//! The image: the flight module behind its link.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "the firmware runs on a Cortex-M4F: build it with --target thumbv7em-none-eabihf and a board's feature"
    );
}

#[cfg(target_os = "none")]
mod image {
    use cortex_m_rt::entry;
    use schuler_core::module::FlightModule;
    use schuler_firmware::{board, start};
    use schuler_link::endpoint::Endpoint;

    #[cfg(feature = "semihosting")]
    use schuler_firmware::semihosting as link;
    #[cfg(not(feature = "semihosting"))]
    use schuler_firmware::serial as link;

    #[entry]
    fn main() -> ! {
        // In statics from the start: they are too big to be built on the stack and moved.
        static mut MODULE: FlightModule = FlightModule::new();
        static mut ENDPOINT: Endpoint = Endpoint::unidentified();

        board::start();
        ENDPOINT.identify(start::introduce(link::IDENTITY));
        link::run(ENDPOINT, MODULE)
    }
}
