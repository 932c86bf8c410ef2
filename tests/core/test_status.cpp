// Status: what it says, and that it can be used where no code runs.
#include <type_traits>

#include "check.hpp"
#include "servosense/core/status.hpp"

int main() {
  using servosense::Status;
  constexpr Status good;
  static_assert(good.ok());
  static_assert(std::is_trivially_copyable_v<Status>);
  CHECK_TEXT(good.reason(), "");
  CHECK_TEXT(good.parameter(), "");

  constexpr Status bad = Status::invalid("cutoff_rad_s", "must be positive");
  static_assert(!bad.ok());
  CHECK_TEXT(bad.parameter(), "cutoff_rad_s");
  CHECK_TEXT(bad.reason(), "must be positive");

  // A reason that is empty is still a refusal.
  CHECK(!Status::invalid("", "").ok());
  return check::done();
}
