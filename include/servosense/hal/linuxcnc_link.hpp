// LinuxCNC by its network interface, linuxcncrsh (TCP 5007): a line asks, a line answers.
//
//   hello EMC servosense 1.0    HELLO ACK EMCNETSVR 1.1
//   set pause                   SET PAUSE ACK
//   get program_status          PROGRAM_STATUS PAUSED
//
// NC text goes as MDI blocks; a block that the interpreter finds fault with is refused. The feed is
// held by pausing, which LinuxCNC does to programs and MDI moves, and not to jogs of its panel.
// Positions are those of the machine (G53). linuxcncrsh acknowledges a command 0.1 s after it; the
// machine acts at once. Whoever enables a second connection takes control from this one: `reset`.
// Passwords and commands go in the clear: keep it to a network of your own.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "servosense/core/expected.hpp"
#include "servosense/hal/cnc_link.hpp"

namespace servosense {

struct LinuxCncConfig {
  std::string host = "127.0.0.1";
  std::uint16_t port = 5007;
  std::string connect_password = "EMC";
  std::string enable_password = "EMCTOO";
  double time_limit_s = 0.5;  ///< of one try
};

/// linuxcnc://[CONNECT:ENABLE@]HOST[:PORT], the two passwords of linuxcncrsh before the @.
Expected<LinuxCncConfig> linuxcnc_config(const std::string& url);

class LinuxCncLink final : public CncLink {
 public:
  explicit LinuxCncLink(const LinuxCncConfig& config);
  ~LinuxCncLink() override;

  [[nodiscard]] const std::string& name() const override;
  CncReply connect() override;
  CncReply send(std::string_view text, std::size_t& taken) override;
  CncReply status(CncStatus& status) override;
  CncReply hold_feed(bool hold) override;
  CncReply set_feed_override(double factor) override;
  CncReply set_spindle_override(double factor) override;
  CncReply overrides(CncOverrides& overrides) override;
  /// What LinuxCNC said when it last refused a block; empty if nothing.
  [[nodiscard]] const std::string& complaint() const;

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace servosense
