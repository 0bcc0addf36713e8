// Enable, close until something is held, and leave: the daemon keeps holding.
// g++ -std=c++17 -o grasp grasp.cpp && ./grasp /run/litegripd/can0.sock
#include <cstdio>
#include <stdexcept>
#include <string>
#include <sys/socket.h>
#include <sys/un.h>

class Daemon {
    int fd = socket(AF_UNIX, SOCK_STREAM, 0), last_id = 0;

  public:
    explicit Daemon(const std::string &path) {
        sockaddr_un at{AF_UNIX, {}};
        path.copy(at.sun_path, sizeof at.sun_path - 1);
        if (connect(fd, reinterpret_cast<sockaddr *>(&at), sizeof at) != 0)
            throw std::runtime_error("no daemon listens at " + path);
    }

    // Send a request and wait for its answer: a line of JSON, for a library of your choice.
    std::string call(const std::string &method, const std::string &params = "{}") {
        std::string line = R"({"jsonrpc":"2.0","id":)" + std::to_string(++last_id) +
                           R"(,"method":")" + method + R"(","params":)" + params + "}\n";
        send(fd, line.data(), line.size(), MSG_NOSIGNAL);
        line.clear();
        for (char c; recv(fd, &c, 1, 0) == 1 && c != '\n';) line += c;
        if (line.find(R"("result":)") == std::string::npos) throw std::runtime_error(line);
        return line;
    }
};

int main(int count, char **arguments) try {
    if (count != 2)
        throw std::runtime_error("usage: grasp SOCKET, for example /run/litegripd/can0.sock");
    Daemon gripper(arguments[1]);
    gripper.call("motor.enable");
    puts(gripper.call("motion.grasp", R"({"force_n":10,"until":"verdict"})").c_str());
} catch (const std::exception &error) {
    fprintf(stderr, "%s\n", error.what());
    return 1;
}
