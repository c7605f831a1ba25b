// Sockets, signals and time on POSIX and on Windows: what C++14's own library lacks.
#pragma once

#ifdef _WIN32
#ifndef NOMINMAX
#define NOMINMAX  // windows.h would define min and max as macros
#endif
#include <winsock2.h>
#include <ws2tcpip.h>
#include <windows.h>
#else
#include <arpa/inet.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#endif

#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "array.hpp"

namespace palpate {

// Seconds on a clock that never goes back.
inline double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

inline void sleep_a_millisecond() {
#ifdef _WIN32
  Sleep(1);
#else
  poll(nullptr, 0, 1);
#endif
}

// The signals that end the program: SIGINT, SIGTERM and SIGHUP; on Windows Ctrl-C, Ctrl-Break, and the console's end.
struct EndSignal {
  static std::atomic<bool>& came() {
    static std::atomic<bool> value{false};
    return value;
  }
#ifdef _WIN32
  static std::atomic<bool>& is_off() {
    static std::atomic<bool> value{false};
    return value;
  }
  static BOOL WINAPI handle(DWORD event) {
    if (came().exchange(true)) return FALSE;                      // the second one ends the program at once
    for (int i = 0; event >= CTRL_CLOSE_EVENT && i < 3000 && !is_off(); ++i) Sleep(1);  // returning ends the program
    return TRUE;
  }
  static void watch() {
    came();
    is_off();
    SetConsoleCtrlHandler(&handle, TRUE);
  }
  static void set_off() { is_off() = true; }
#else
  static void handle(int number) {
    came() = true;
    std::signal(number, SIG_DFL);  // the second one ends the program at once, if the library does not stop
  }
  static void watch() {
    came();  // made here, since a handler must not
    for (int number : {SIGINT, SIGTERM, SIGHUP}) std::signal(number, &handle);
    std::signal(SIGPIPE, SIG_IGN);  // who reads the output may go away
  }
  static void set_off() {}
#endif
};

// A TCP socket that never waits; closed with its owner.
class Socket {
 public:
#ifdef _WIN32
  using Handle = SOCKET;
  using Size = int;  // of what is sent or received at once
  static constexpr Handle none = INVALID_SOCKET;
#else
  using Handle = int;
  using Size = std::size_t;
  static constexpr Handle none = -1;
#endif

  Socket() = default;
  explicit Socket(Handle handle) : handle_(handle) {}
  Socket(Socket&& other) noexcept : handle_(other.handle_) { other.handle_ = none; }
  Socket& operator=(Socket&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Socket() {
    if (handle_ == none) return;
#ifdef _WIN32
    closesocket(handle_);
#else
    ::close(handle_);
#endif
  }

  static void prepare_system() {
#ifdef _WIN32
    WSADATA data;
    if (WSAStartup(MAKEWORD(2, 2), &data) != 0) throw Failure("Windows cannot start its sockets");
#endif
  }

  // A socket that listens; `port` 0 takes any that is free. `is_loopback` says whether this machine alone reaches it.
  static Socket listen(const std::string& address, unsigned port, bool& is_loopback) {
    addrinfo hints{};
    hints.ai_family = AF_UNSPEC;
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = AI_PASSIVE;
    addrinfo* found = nullptr;
    if (getaddrinfo(address.c_str(), std::to_string(port).c_str(), &hints, &found) != 0)
      throw Failure("--listen " + address + " is no address of this machine");
    is_loopback = is_loopback_address(found->ai_addr);
    Socket made(::socket(found->ai_family, found->ai_socktype, found->ai_protocol));
    int yes = 1;
#ifdef _WIN32
    int option = SO_EXCLUSIVEADDRUSE;  // else a second program could take the same port
#else
    int option = SO_REUSEADDR;  // else the port is refused for a minute after each end
#endif
    setsockopt(made.handle_, SOL_SOCKET, option, reinterpret_cast<const char*>(&yes), sizeof yes);
    bool is_bound = ::bind(made.handle_, found->ai_addr, static_cast<socklen_t>(found->ai_addrlen)) == 0;
    freeaddrinfo(found);
    if (!is_bound || ::listen(made.handle_, 8) != 0)
      throw Failure("cannot listen at " + address + " port " + std::to_string(port) + ": " + last_error() +
                    " (--listen takes an address of this machine; if another palpate-ultraleap runs, --port takes "
                    "another port)");
    made.never_wait();
    return made;
  }

  // The next client; an empty socket if there is none.
  Socket accept() const {
    Socket made(::accept(handle_, nullptr, nullptr));
    if (made) {
      made.never_wait();
      int yes = 1;
      setsockopt(made.handle_, IPPROTO_TCP, TCP_NODELAY, reinterpret_cast<const char*>(&yes), sizeof yes);
    }
    return made;
  }

  explicit operator bool() const { return handle_ != none; }
  Handle handle() const { return handle_; }

  unsigned local_port() const {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    getsockname(handle_, reinterpret_cast<sockaddr*>(&address), &size);
    char service[32] = "0";
    getnameinfo(reinterpret_cast<sockaddr*>(&address), size, nullptr, 0, service, sizeof service, NI_NUMERICSERV);
    return static_cast<unsigned>(std::stoul(service));
  }

  std::string peer() const {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    char host[128] = "?", service[32] = "?";
    if (getpeername(handle_, reinterpret_cast<sockaddr*>(&address), &size) == 0)
      getnameinfo(reinterpret_cast<sockaddr*>(&address), size, host, sizeof host, service, sizeof service,
                  NI_NUMERICHOST | NI_NUMERICSERV);
    return std::string(host) + " port " + service;
  }

  // Bytes that were received; 0: none now; -1: the connection ended.
  int receive(std::uint8_t* bytes, std::size_t size) const {
    int got = static_cast<int>(::recv(handle_, reinterpret_cast<char*>(bytes), static_cast<Size>(size), 0));
    return got > 0 ? got : (got < 0 && would_wait() ? 0 : -1);
  }

  // Bytes that were sent; 0: none now; -1: the connection ended.
  int send(const std::uint8_t* bytes, std::size_t size) const {
    int sent = static_cast<int>(::send(handle_, reinterpret_cast<const char*>(bytes), static_cast<Size>(size), 0));
    return sent >= 0 ? sent : (would_wait() ? 0 : -1);
  }

  void end_sending() const {
#ifdef _WIN32
    ::shutdown(handle_, SD_SEND);
#else
    ::shutdown(handle_, SHUT_WR);
#endif
  }

  // Waits until one of the sockets has something to read, or for so long.
  static void wait(const std::vector<const Socket*>& sockets, int milliseconds) {
#ifdef _WIN32
    std::vector<WSAPOLLFD> entries;
#else
    std::vector<pollfd> entries;
#endif
    for (const Socket* socket : sockets) {
      entries.emplace_back();
      entries.back().fd = socket->handle_;
      entries.back().events = POLLIN;
      entries.back().revents = 0;
    }
#ifdef _WIN32
    WSAPoll(entries.data(), static_cast<ULONG>(entries.size()), milliseconds);
#else
    poll(entries.data(), static_cast<nfds_t>(entries.size()), milliseconds);
#endif
  }

 private:
  static bool is_loopback_address(const sockaddr* address) {
    if (address->sa_family == AF_INET)
      return (ntohl(reinterpret_cast<const sockaddr_in*>(address)->sin_addr.s_addr) >> 24) == 127;
    return address->sa_family == AF_INET6 &&
           std::memcmp(&reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr, &in6addr_loopback,
                       sizeof in6addr_loopback) == 0;
  }

  static bool would_wait() {
#ifdef _WIN32
    return WSAGetLastError() == WSAEWOULDBLOCK;
#else
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
#endif
  }

  static std::string last_error() {
#ifdef _WIN32
    return "error " + std::to_string(WSAGetLastError());
#else
    return std::strerror(errno);
#endif
  }

  void never_wait() const {
#ifdef _WIN32
    u_long yes = 1;
    ioctlsocket(handle_, static_cast<long>(FIONBIO), &yes);
#else
    fcntl(handle_, F_SETFL, fcntl(handle_, F_GETFL, 0) | O_NONBLOCK);
    fcntl(handle_, F_SETFD, FD_CLOEXEC);
#endif
  }

  Handle handle_ = none;
};

}  // namespace palpate
