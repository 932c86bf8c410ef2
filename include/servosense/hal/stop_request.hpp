// A feed hold for an alarm, sent once an event, without holding up whoever raised it.
//
// raise() is for the thread that runs the monitors: an atomic, and a write to an event descriptor
// when somebody waits for it; no lock, no memory. A thread of its own then tells the controller,
// again and again until it acknowledges, and looks whether the feed is held indeed: by the state of
// the controller, and by its position, which no longer changes. An acknowledgement alone stops
// nothing: what is not seen to stand in time is said at once. While the feed is held, further
// alarms join it. When the operator has released the feed (servosense never does), the next alarm
// is a new event.
//
// Reaction: from the arrival of the sample that raised the alarm to the controller's
// acknowledgement. What comes behind that, braking, is the machine's. With a link whose tries take
// `t` until they fail, n losses in a row cost n (t + retry_s), and a new connection each.
// A monitoring aid, not a safety function: the emergency stop has to work without it.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "servosense/hal/cnc_link.hpp"
#include "servosense/hal/real_time_thread.hpp"

namespace servosense {

struct StopRequestConfig {
  double retry_s = 0.002;  ///< pause between tries
  double watch_s = 0.05;   ///< between looks whether the feed is still held
  double give_up_s = 10;   ///< an alarm so old is no reason to stop any more
  double finish_s = 3;     ///< stop() waits so long for a feed hold that is on its way
  // After an alarm. Conventions: five answers of LinuxCNC; from rapid, 2 m/s at 1 m/s2.
  double effect_s = 0.5;  ///< the controller's state should say that it holds
  double braking_s = 2;   ///< the machine should stand
  double creep_m = 1e-5;  ///< between two looks: what stands may still quiver so much
};

struct StopHealth {
  std::uint64_t raised = 0;   ///< calls of raise()
  std::uint64_t events = 0;   ///< alarms that asked for a feed hold
  std::uint64_t held = 0;     ///< of them, acknowledged
  std::uint64_t seen = 0;     ///< of them, seen to stand
  std::uint64_t overdue = 0;  ///< of them, not seen to in time; some may stand later
  std::uint64_t tries = 0;    ///< feed holds sent
  std::uint64_t joined = 0;   ///< looked at while another held or was on its way
  std::uint64_t released = 0;
  std::uint64_t given_up = 0;
  bool holding = false;  ///< the feed is held, for all we know
  LatencyHistogram reaction;
};

class StopRequest {
 public:
  /// Told by the request's own thread, once an event that is overdue, what the CNC does instead.
  using Complain = std::function<void(const std::string& what)>;
  /// What its thread does with the link besides, while no feed hold is asked for: one try or look
  /// (OverrideRequest::turn). Returns how long it may wait [s]; nothing when the link is silent.
  using Beside = std::function<std::optional<double>()>;
  /// The link must outlive the request, and belong to it and what stands beside it alone.
  explicit StopRequest(CncLink& link, StopRequestConfig config = {}, Complain complain = {},
                       Beside beside = {});
  StopRequest(const StopRequest&) = delete;
  StopRequest& operator=(const StopRequest&) = delete;
  ~StopRequest();

  /// Hold the feed, for a sample that arrived at `arrival_ns` by the link's clock. Never waits.
  void raise(Nanoseconds arrival_ns) noexcept;
  /// An alarm is on its way, or the feed is held.
  [[nodiscard]] bool active() const noexcept { return active_.load(std::memory_order_relaxed); }

  /// Starts the thread; connects.
  void start();
  /// Ends it; what is held stays held.
  void stop();
  /// What the thread does over and over: one try or one look. Returns how long to wait then [s];
  /// negative: until something is raised. For tests, and for hosts that have a thread already.
  double turn();
  [[nodiscard]] StopHealth health() const;

 private:
  enum class Phase { armed, asking, held };
  void run();
  void begin(Nanoseconds arrival_ns);
  double ask();
  double watch();
  double look_beside(double wait_s);
  void look(const CncStatus& status);
  void check_overdue();

  CncLink& link_;
  StopRequestConfig config_;
  Complain complain_;
  Beside beside_;
  int wake_ = -1;
  std::atomic<Nanoseconds> arrival_;
  std::atomic<std::uint64_t> raised_{0};
  std::atomic<bool> active_{false};
  std::atomic<bool> stopping_{false};
  std::thread thread_;

  Phase phase_ = Phase::armed;  // the thread's own, down to here
  bool connected_ = false;
  bool acknowledged_ = false;
  bool told_ = false;    // its state, with the last acknowledgement
  bool seen_ = false;    // to stand
  bool said_ = false;    // that it is overdue
  bool looked_ = false;  // at last_m_
  std::array<double, kAxes> last_m_{};
  Nanoseconds began_ns_ = 0;

  mutable std::mutex mutex_;  // of health_
  StopHealth health_;
};

}  // namespace servosense
