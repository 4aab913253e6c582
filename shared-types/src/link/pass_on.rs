//! Methods of a link that delegate to another link.

/// Implements the named methods of a [`Link`](crate::link::Link) by delegation, for a link that overrides only the
/// others: `pass_on!(self => self.inner; send_control tell)`.
#[macro_export]
macro_rules! pass_on {
    ($self:ident => $link:expr; $($method:ident)+) => {
        $( $crate::pass_on!(@ $method $self ($link)); )+
    };
    (@ send_control $self:ident $link:tt) => {
        fn send_control(&mut $self, message: &[u8]) -> Result<(), $crate::link::LinkError> {
            $link.send_control(message)
        }
    };
    (@ send_message $self:ident $link:tt) => {
        fn send_message(
            &mut $self,
            message: $crate::hello::Control,
        ) -> Result<(), $crate::link::LinkError> {
            $link.send_message(message)
        }
    };
    (@ receive_message $self:ident $link:tt) => {
        fn receive_message(
            &mut $self,
        ) -> Result<Option<Option<$crate::hello::Control>>, $crate::link::LinkError> {
            $link.receive_message()
        }
    };
    (@ tell $self:ident $link:tt) => {
        fn tell(&mut $self, message: &[u8]) -> Result<(), $crate::link::LinkError> {
            $link.tell(message)
        }
    };
    (@ receive_control $self:ident $link:tt) => {
        fn receive_control(&mut $self) -> Result<Option<Vec<u8>>, $crate::link::LinkError> {
            $link.receive_control()
        }
    };
    (@ expect $self:ident $link:tt) => {
        fn expect(&mut $self, epoch: u32) -> Result<(), $crate::link::LinkError> {
            $link.expect(epoch)
        }
    };
    (@ peer $self:ident $link:tt) => {
        fn peer(&$self) -> Result<$crate::link::Peer, $crate::link::LinkError> {
            $link.peer()
        }
    };
    (@ open_frames $self:ident $link:tt) => {
        fn open_frames(&mut $self, spec: &$crate::link::FrameSpec) -> Result<(), $crate::link::LinkError> {
            $link.open_frames(spec)
        }
    };
    (@ take_over $self:ident $link:tt) => {
        fn take_over(&mut $self) {
            $link.take_over();
        }
    };
    (@ send $self:ident $link:tt) => {
        #[inline]
        fn send(&mut $self, header: &$crate::frame::Header, values: &[f64]) -> Result<(), $crate::link::LinkError> {
            $link.send(header, values)
        }
    };
    (@ receive $self:ident $link:tt) => {
        #[inline]
        fn receive(&mut $self, values: &mut [f64]) -> Result<Option<$crate::frame::Header>, $crate::link::LinkError> {
            $link.receive(values)
        }
    };
    (@ rejected $self:ident $link:tt) => {
        fn rejected(&$self) -> $crate::ignored::Ignored {
            $link.rejected()
        }
    };
    (@ sleeper $self:ident $link:tt) => {
        fn sleeper(&$self) -> Option<Box<dyn $crate::wait::Sleeper>> {
            $link.sleeper()
        }
    };
}
