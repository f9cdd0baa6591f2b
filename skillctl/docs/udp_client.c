/* A robot behind `skillctl run SKILL --driver udp`: cc -O2 -o udp_client udp_client.c; ./udp_client X Y Z [PORT]
   This one simulates its hand at 1 kHz. Put your controller where it says so. */
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
int main(int count, char **words) {
    if (count < 4) return fprintf(stderr, "usage: udp_client X Y Z [PORT]\n"), 2;
    double p[3] = {atof(words[1]), atof(words[2]), atof(words[3])}, v[3] = {0}, told[3] = {0};
    int s = socket(AF_INET, SOCK_DGRAM, 0), done = 0, running = 1, answers = 0;
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(count > 4 ? atoi(words[4]) : 5005)};
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (long n = 1, heard = 0; running; n++) {
        char line[512] = {0};
        while (recv(s, line, sizeof line - 1, MSG_DONTWAIT) > 0) { /* the newest command counts */
            long number;
            if (sscanf(line, "move %ld %lf %lf %lf", &number, told, told + 1, told + 2) == 4) heard = n, answers++;
            if (sscanf(line, "event %ld", &number) == 1) done = number; /* open or close the gripper here */
            if (!strncmp(line, "stop", 4)) running = 0;
            memset(line, 0, sizeof line);
        }
        if (n - heard > 100) memset(told, 0, sizeof told); /* nothing came for 0.1 s: rest */
        for (int i = 0; i < 3; i++) v[i] += 0.05 * (told[i] - v[i]), p[i] += 1e-3 * v[i]; /* move, and measure, here */
        int length = snprintf(line, sizeof line, "state %ld %d %.9g %.9g %.9g\n", n, done, p[0], p[1], p[2]);
        sendto(s, line, length, 0, (struct sockaddr *)&to, sizeof to);
        due.tv_nsec += 1000000;
        if (due.tv_nsec >= 1000000000) due.tv_nsec -= 1000000000, due.tv_sec++;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    }
    printf("%d commands; the hand rests at %.4f, %.4f, %.4f\n", answers, p[0], p[1], p[2]);
    return 0;
}
